//! What goes around layers and is added up: kept in f32, also where the layers compute in a narrower type. Over tens of
//! blocks its rounding would be the largest error.

use crate::backend::{Backend, Binary};
use crate::{DType, NetError};

/// `x + layer`. The layer adds `x` itself where everything is f32, and is given nothing to add elsewhere.
pub(crate) fn added<B: Backend>(
    b: &B,
    x: B::Tensor,
    layer: impl FnOnce(Option<B::Tensor>) -> Result<B::Tensor, NetError>,
) -> Result<B::Tensor, NetError> {
    if b.preferred() == DType::F32 { layer(Some(x)) } else { b.binary(x, &layer(None)?, Binary::Add) }
}

/// `x` in f32: itself where it is that already.
pub(crate) fn wide<B: Backend>(b: &B, x: B::Tensor) -> Result<B::Tensor, NetError> {
    if b.preferred() == DType::F32 { Ok(x) } else { b.cast(&x, DType::F32) }
}
