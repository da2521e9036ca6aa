//! Reading and checking part models that somebody else wrote.

use super::PartModel;

/// What is wrong with a part model.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PartModelError {
    /// The JSON does not fit.
    #[error("{path}: {problem}")]
    Json {
        /// Where, such as `parts[3].round`.
        path: String,
        /// What is wrong and what is allowed.
        problem: String,
    },
    /// A value cannot be used.
    #[error("{path}: {problem}")]
    Value {
        /// Where, such as `parts[3].round`.
        path: String,
        /// What is wrong and what is allowed.
        problem: String,
    },
    /// Too many parts once expanded.
    #[error("{count} parts after repeats and mirrors; at most {limit} are allowed")]
    TooManyParts {
        /// Counted.
        count: usize,
        /// Allowed.
        limit: usize,
    },
    /// The size is not usable.
    #[error("size {width} x {height} x {depth} m; each must lie between {min} and {max}")]
    Size {
        /// Given.
        width: f64,
        /// Given.
        height: f64,
        /// Given.
        depth: f64,
        /// Smallest side, metres.
        min: f64,
        /// Largest side, metres.
        max: f64,
    },
}

pub(super) fn from_json(text: &str) -> Result<PartModel, PartModelError> {
    let model: PartModel =
        serde_json::from_str(text).map_err(|e| PartModelError::Json { path: String::new(), problem: e.to_string() })?;
    check(&model)?;
    Ok(model)
}

pub(super) fn from_value(value: &serde_json::Value) -> Result<PartModel, PartModelError> {
    from_json(&value.to_string())
}

#[expect(clippy::unnecessary_wraps, reason = "filled in next")]
pub(super) fn check(_model: &PartModel) -> Result<(), PartModelError> {
    Ok(())
}

pub(super) fn parse_color(text: &str) -> Option<[u8; 3]> {
    let hex = text.trim().trim_start_matches('#');
    let value = u32::from_str_radix(hex, 16).ok()?;
    (hex.len() == 6).then(|| [(value >> 16) as u8, (value >> 8) as u8, value as u8])
}
