//! The values that modelling functions make: one type of the language, many kinds.
#![expect(unsafe_code, reason = "the derives of starlark's value write unsafe impls; nothing here does")]

use std::fmt;
use std::sync::{Arc, Mutex};

use allocative::Allocative;
use glam::DVec3;
use harmony_shape::tree::{Curve, NodeId, Outline};
use harmony_shape::{Pattern, PhotoMap};
use starlark::any::ProvidesStaticType;
use starlark::eval::{Arguments, Evaluator};
use starlark::starlark_simple_value;
use starlark::values::{Heap, NoSerialize, StarlarkValue, Value, starlark_value};

use crate::bounds::Bounds;
use crate::call;
use crate::error::{Complaint, Failure};
use crate::functions::{maths::Dice, methods, room::Frame};
use crate::numbers;

/// What a value is.
#[derive(Debug, Clone)]
pub(crate) enum Kind {
    Vector(DVec3),
    Curve(Arc<Curve>),
    Outline(Arc<Outline>),
    Part(NodeId, Option<Bounds>),
    Material(u32),
    Pattern(Arc<Pattern>),
    Photo(Arc<PhotoMap>),
    Frame(Arc<Frame>),
    /// Edge of a cloth, known when it is meshed.
    Hem(NodeId, Arc<str>),
    Dice(Arc<Mutex<Dice>>),
    /// A function by its index.
    Function(usize),
    /// A method of a value by its index.
    Method(Box<Kind>, usize),
}

/// A value of the language.
#[derive(Debug, Clone, ProvidesStaticType, NoSerialize, Allocative)]
pub(crate) struct Thing {
    #[allocative(skip)]
    pub kind: Kind,
}

starlark_simple_value!(Thing);

impl Kind {
    /// What it is called in messages.
    pub fn word(&self) -> &'static str {
        match self {
            Self::Vector(_) => "vec",
            Self::Curve(_) => "curve",
            Self::Outline(_) => "outline",
            Self::Part(..) => "part",
            Self::Material(_) => "mat",
            Self::Pattern(_) => "pattern",
            Self::Photo(_) => "photo",
            Self::Frame(_) => "frame",
            Self::Hem(..) => "hem",
            Self::Dice(_) => "rng",
            Self::Function(_) | Self::Method(..) => "function",
        }
    }
}

impl From<Kind> for Thing {
    fn from(kind: Kind) -> Self {
        Self { kind }
    }
}

impl fmt::Display for Thing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.kind {
            Kind::Vector(v) => write!(f, "vec({}, {}, {})", v.x, v.y, v.z),
            Kind::Function(index) => write!(f, "{}", call::function(*index).name),
            Kind::Method(receiver, index) => write!(f, "{}.{}", receiver.word(), call::method(receiver, *index).name),
            kind => write!(f, "<{}>", kind.word()),
        }
    }
}

/// A value as a message names it.
pub(crate) fn word(value: Value<'_>) -> &'static str {
    match Thing::from_value(value) {
        Some(thing) => thing.kind.word(),
        None => match value.get_type() {
            "NoneType" => "None",
            other => other,
        },
    }
}

fn arithmetic<T>(sign: &str, left: &str, right: &str) -> Result<T, starlark::Error> {
    let complaint = Complaint::new(format!("{left} {sign} {right} means nothing")).with_hint(
        "vec + vec, vec - vec, vec * number, vec / number; parts are moved with .at() and joined with group()",
    );
    Err(Failure::Complaint(complaint).into())
}

#[starlark_value(type = "thing")]
impl<'v> StarlarkValue<'v> for Thing {
    fn invoke(
        &self,
        _me: Value<'v>,
        args: &Arguments<'v, '_>,
        eval: &mut Evaluator<'v, '_, '_>,
    ) -> starlark::Result<Value<'v>> {
        match &self.kind {
            Kind::Function(index) => call::invoke(call::function(*index), None, args, eval),
            Kind::Method(receiver, index) => {
                call::invoke(call::method(receiver, *index), Some((**receiver).clone()), args, eval)
            }
            kind => {
                let complaint = Complaint::new(format!("a {} is not a function", kind.word()));
                Err(Failure::Complaint(complaint).into())
            }
        }
    }

    fn name_for_call_stack(&self, _me: Value<'v>) -> String {
        self.to_string()
    }

    fn get_attr(&self, attribute: &str, heap: &'v Heap) -> Option<Value<'v>> {
        let vector = |v: DVec3| heap.alloc(Thing::from(Kind::Vector(v)));
        let number = |x: f64| heap.alloc(x);
        let own = match (&self.kind, attribute) {
            (Kind::Vector(v), "x") => Some(number(v.x)),
            (Kind::Vector(v), "y") => Some(number(v.y)),
            (Kind::Vector(v), "z") => Some(number(v.z)),
            (Kind::Vector(v), "len") => Some(number(v.length())),
            (Kind::Vector(v), "unit") => Some(vector(v.normalize_or_zero())),
            (Kind::Curve(c), "len") => Some(number(crate::curves::length(c))),
            (Kind::Curve(c), "start") => c.points.first().map(|p| vector((*p).into())),
            (Kind::Curve(c), "end") => c.points.last().map(|p| vector((*p).into())),
            (Kind::Curve(c), "points") => {
                Some(heap.alloc(c.points.iter().map(|p| vector((*p).into())).collect::<Vec<_>>()))
            }
            (Kind::Part(_, Some(b)), "size") => Some(vector(b.size())),
            (Kind::Part(_, Some(b)), "top") => Some(number(b.max.y)),
            (Kind::Part(_, Some(b)), "min") => Some(vector(b.min)),
            (Kind::Part(_, Some(b)), "max") => Some(vector(b.max)),
            (Kind::Part(_, Some(b)), "centre" | "center") => Some(vector(b.centre())),
            (Kind::Outline(o), "size") => {
                crate::bounds::of_outline(o).map(|[min, max]| vector(DVec3::new(max[0] - min[0], max[1] - min[1], 0.0)))
            }
            (Kind::Frame(f), "u") => Some(number(f.size[0])),
            (Kind::Frame(f), "v") => Some(number(f.size[1])),
            (Kind::Frame(f), "normal") => Some(vector(f.normal)),
            _ => None,
        };
        own.or_else(|| {
            let index = methods(&self.kind).iter().position(|f| f.name == attribute)?;
            Some(heap.alloc(Thing::from(Kind::Method(Box::new(self.kind.clone()), index))))
        })
    }

    fn dir_attr(&self) -> Vec<String> {
        let own: &[&str] = match &self.kind {
            Kind::Vector(_) => &["x", "y", "z", "len", "unit"],
            Kind::Curve(_) => &["len", "start", "end", "points"],
            Kind::Part(..) => &["size", "top", "min", "max", "centre"],
            Kind::Outline(_) => &["size"],
            Kind::Frame(_) => &["u", "v", "normal"],
            _ => &[],
        };
        let methods = methods(&self.kind).iter().map(|f| f.name.as_str());
        own.iter().copied().chain(methods).map(str::to_owned).collect()
    }

    fn equals(&self, other: Value<'v>) -> starlark::Result<bool> {
        Ok(match (&self.kind, Self::from_value(other).map(|t| &t.kind)) {
            (Kind::Vector(a), Some(Kind::Vector(b))) => a == b,
            (Kind::Part(a, _), Some(Kind::Part(b, _))) => a == b,
            (Kind::Material(a), Some(Kind::Material(b))) => a == b,
            _ => false,
        })
    }

    fn length(&self) -> starlark::Result<i32> {
        match &self.kind {
            Kind::Vector(_) => Ok(3),
            kind => {
                let complaint = Complaint::new(format!("len() of a {} means nothing", kind.word()))
                    .with_hint("a curve's length is curve.len");
                Err(Failure::Complaint(complaint).into())
            }
        }
    }

    fn at(&self, index: Value<'v>, heap: &'v Heap) -> starlark::Result<Value<'v>> {
        match (&self.kind, index.unpack_i32()) {
            (Kind::Vector(v), Some(i @ -3..=2)) => Ok(heap.alloc(v.to_array()[i.rem_euclid(3) as usize])),
            (kind, _) => {
                let complaint = Complaint::new(format!("a {} has no element {}", kind.word(), index.to_repr()));
                Err(Failure::Complaint(complaint).into())
            }
        }
    }

    fn iterate_collect(&self, heap: &'v Heap) -> starlark::Result<Vec<Value<'v>>> {
        match &self.kind {
            Kind::Vector(v) => Ok(v.to_array().into_iter().map(|x| heap.alloc(x)).collect()),
            kind => {
                let complaint = Complaint::new(format!("a {} is no list", kind.word()));
                Err(Failure::Complaint(complaint).into())
            }
        }
    }

    fn plus(&self, heap: &'v Heap) -> starlark::Result<Value<'v>> {
        match &self.kind {
            Kind::Vector(v) => Ok(heap.alloc(Self::from(Kind::Vector(*v)))),
            kind => arithmetic("+", "", kind.word()),
        }
    }

    fn minus(&self, heap: &'v Heap) -> starlark::Result<Value<'v>> {
        match &self.kind {
            Kind::Vector(v) => Ok(heap.alloc(Self::from(Kind::Vector(-*v)))),
            kind => arithmetic("-", "", kind.word()),
        }
    }

    fn add(&self, rhs: Value<'v>, heap: &'v Heap) -> Option<starlark::Result<Value<'v>>> {
        Some(match (&self.kind, numbers::vector(rhs)) {
            (Kind::Vector(a), Some(b)) => Ok(heap.alloc(Self::from(Kind::Vector(*a + b)))),
            (kind, _) => arithmetic("+", kind.word(), word(rhs)),
        })
    }

    fn radd(&self, lhs: Value<'v>, heap: &'v Heap) -> Option<starlark::Result<Value<'v>>> {
        Some(match (&self.kind, numbers::vector(lhs)) {
            (Kind::Vector(a), Some(b)) => Ok(heap.alloc(Self::from(Kind::Vector(*a + b)))),
            // sum() of vectors begins with 0.
            (Kind::Vector(a), None) if lhs.unpack_i32() == Some(0) => Ok(heap.alloc(Self::from(Kind::Vector(*a)))),
            (kind, _) => arithmetic("+", word(lhs), kind.word()),
        })
    }

    fn sub(&self, other: Value<'v>, heap: &'v Heap) -> starlark::Result<Value<'v>> {
        match (&self.kind, numbers::vector(other)) {
            (Kind::Vector(a), Some(b)) => Ok(heap.alloc(Self::from(Kind::Vector(*a - b)))),
            (kind, _) => arithmetic("-", kind.word(), word(other)),
        }
    }

    fn mul(&self, rhs: Value<'v>, heap: &'v Heap) -> Option<starlark::Result<Value<'v>>> {
        Some(match (&self.kind, numbers::number(rhs)) {
            (Kind::Vector(a), Some(k)) => Ok(heap.alloc(Self::from(Kind::Vector(*a * k)))),
            (kind, _) => arithmetic("*", kind.word(), word(rhs)),
        })
    }

    fn rmul(&self, lhs: Value<'v>, heap: &'v Heap) -> Option<starlark::Result<Value<'v>>> {
        self.mul(lhs, heap)
    }

    fn div(&self, other: Value<'v>, heap: &'v Heap) -> starlark::Result<Value<'v>> {
        match (&self.kind, numbers::number(other)) {
            (Kind::Vector(a), Some(k)) if k != 0.0 => Ok(heap.alloc(Self::from(Kind::Vector(*a / k)))),
            (kind, _) => arithmetic("/", kind.word(), word(other)),
        }
    }
}
