//! Numbers of the language as numbers of ours.

use glam::DVec3;
use starlark::values::float::UnpackFloat;
use starlark::values::list::ListRef;
use starlark::values::tuple::TupleRef;
use starlark::values::{UnpackValue, Value};

use crate::thing::{Kind, Thing};

/// An int or a float; no bool, nothing that is not finite.
pub(crate) fn number(value: Value<'_>) -> Option<f64> {
    if value.unpack_bool().is_some() {
        return None;
    }
    let UnpackFloat(x) = UnpackFloat::unpack_value(value).ok()??;
    x.is_finite().then_some(x)
}

/// Elements of a list or a tuple.
pub(crate) fn items(value: Value<'_>) -> Option<&[Value<'_>]> {
    ListRef::from_value(value).map(ListRef::content).or_else(|| TupleRef::from_value(value).map(TupleRef::content))
}

/// Numbers of a list, a tuple or a vector.
pub(crate) fn numbers(value: Value<'_>) -> Option<Vec<f64>> {
    if let Some(Kind::Vector(v)) = Thing::from_value(value).map(|t| &t.kind) {
        return Some(v.to_array().to_vec());
    }
    items(value)?.iter().map(|v| number(*v)).collect()
}

/// A vector of three.
pub(crate) fn vector(value: Value<'_>) -> Option<DVec3> {
    if let Some(Kind::Vector(v)) = Thing::from_value(value).map(|t| &t.kind) {
        return Some(*v);
    }
    match numbers(value)?[..] {
        [x, y, z] => Some(DVec3::new(x, y, z)),
        _ => None,
    }
}
