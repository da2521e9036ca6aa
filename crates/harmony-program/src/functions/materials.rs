//! Looks: slot materials, patterns at metric scale, pieces of the photo.

use std::sync::Arc;

use harmony_shape::material::PatternKind;
use harmony_shape::{MaterialSpec, Pattern, PhotoMap};
use starlark::values::Value;

use crate::call::{ANGLE, Call, Function, LENGTH, Outcome, SHARE};
use crate::error::Complaint;
use crate::numbers::{items, numbers};
use crate::thing::{Kind, Thing};

/// A plain material.
pub(crate) fn plain(name: &str, color: &str) -> MaterialSpec {
    MaterialSpec {
        name: name.to_owned(),
        color: color.to_owned(),
        rough: 0.6,
        metal: 0.0,
        sheen: 0.0,
        alpha: 1.0,
        transmission: 0.0,
        ior: 1.45,
        emit: 0.0,
        kelvin: None,
        bump: 1.0,
        map: None,
        photo: None,
        paint: false,
    }
}

/// A colour: `#rrggbb`, `#rgb`, or three numbers (0 to 1, or 0 to 255 where one is above 1).
pub(crate) fn color(value: Value<'_>) -> Option<String> {
    if let Some(text) = value.unpack_str() {
        let hex = text.trim().strip_prefix('#')?;
        if !hex.bytes().all(|b| b.is_ascii_hexdigit()) {
            return None;
        }
        return match hex.len() {
            3 => Some(format!("#{}", hex.chars().flat_map(|c| [c, c]).collect::<String>().to_ascii_lowercase())),
            6 => Some(format!("#{}", hex.to_ascii_lowercase())),
            8 => Some(format!("#{}", hex[..6].to_ascii_lowercase())),
            _ => None,
        };
    }
    let list = numbers(value)?;
    let [r, g, b] = <[f64; 3]>::try_from(list.get(..3)?).ok()?;
    let scale = if r.max(g).max(b) > 1.0 { 1.0 } else { 255.0 };
    let byte = |x: f64| libm::round((x * scale).clamp(0.0, 255.0)) as u8;
    Some(format!("#{:02x}{:02x}{:02x}", byte(r), byte(g), byte(b)))
}

pub(crate) fn functions() -> Vec<Function> {
    vec![
        Function::new(
            "mat(name, color=\"#c0b8ac\", rough=0.6, metal=0, sheen=0, alpha=1, transmission=0, ior=1.45, emit=0, kelvin=None, map=None, bump=1, paint=False)",
            mat,
        ),
        Function::new("photo(quad, size, delit=False)", photo),
        Function::new("over(a, b, mask=0.5)", |c| layered(c, PatternKind::Over)),
        Function::new("tint(map, color, amount=1)", |c| layered(c, PatternKind::Tint)),
        Function::new("ramp(a, b, axis=\"y\")", |c| {
            let colors = vec![need_color(c, "a")?, need_color(c, "b")?];
            let variant = c.word("axis", &["x", "y", "z", "u", "v"], "y")?.to_owned();
            finish(c, Pattern { colors, variant, ..Pattern::new(PatternKind::Ramp) })
        }),
        Function::new("motif(outline, pitch=0.1, jitter=0.2, turn=0, at=None, colors=None, seed=None)", |c| {
            let outline = c.outline("outline")?.points.clone();
            let pattern = Pattern {
                outline,
                width: c.number("pitch", 0.1, LENGTH)?,
                amount: c.number("jitter", 0.2, SHARE)?,
                ..Pattern::new(PatternKind::Motif)
            };
            common(c, pattern)
        }),
    ]
}

/// Patterns of one form: main width, length, joint, amount, variants.
pub(crate) fn patterns() -> Vec<Function> {
    macro_rules! pattern {
        ($kind:ident, $signature:literal) => {
            Function::new($signature, |c| sized(c, PatternKind::$kind))
        };
    }
    vec![
        pattern!(
            Planks,
            "planks(w=0.14, l=1.8, joint=0.001, tone=0.3, amount=0.5, kind=\"running\", turn=0, at=None, colors=None, seed=None)"
        ),
        pattern!(
            Parquet,
            "parquet(kind=\"herringbone\", w=0.07, l=0.42, joint=0.001, tone=0.3, amount=0.5, turn=0, at=None, colors=None, seed=None)"
        ),
        pattern!(
            Tiles,
            "tiles(w=0.3, h=None, joint=0.003, kind=\"stack\", tone=0.1, amount=0.2, turn=0, at=None, colors=None, seed=None)"
        ),
        pattern!(
            Brick,
            "brick(w=0.24, h=0.071, joint=0.01, kind=\"running\", tone=0.4, amount=0.4, turn=0, at=None, colors=None, seed=None)"
        ),
        pattern!(Checks, "checks(c=0.1, h=None, tone=0, turn=0, at=None, colors=None, seed=None)"),
        pattern!(Stripes, "stripes(w=0.05, joint=None, tone=0, turn=0, at=None, colors=None, seed=None)"),
        pattern!(Dots, "dots(pitch=0.05, r=0.012, kind=\"diagonal\", tone=0, turn=0, at=None, colors=None, seed=None)"),
        pattern!(Weave, "weave(yarn=0.001, tone=0.1, amount=0.5, turn=0, at=None, colors=None, seed=None)"),
        pattern!(Knit, "knit(gauge=0.005, tone=0.1, amount=0.5, turn=0, at=None, colors=None, seed=None)"),
        pattern!(Terry, "terry(pitch=0.002, tone=0.1, amount=0.5, colors=None, seed=None)"),
        pattern!(Boucle, "boucle(pitch=0.004, tone=0.1, amount=0.5, colors=None, seed=None)"),
        pattern!(Pile, "pile(pitch=0.002, tone=0.15, amount=0.5, colors=None, seed=None)"),
        pattern!(Leather, "leather(grain=0.002, tone=0.1, amount=0.5, colors=None, seed=None)"),
        pattern!(Wood, "wood(grain=\"y\", w=0.1, tone=0.15, amount=0.5, turn=0, at=None, colors=None, seed=None)"),
        pattern!(Marble, "marble(scale=0.4, tone=0.1, amount=0.4, turn=0, at=None, colors=None, seed=None)"),
        pattern!(Terrazzo, "terrazzo(chip=0.012, tone=0.3, amount=0.5, colors=None, seed=None)"),
        pattern!(Concrete, "concrete(scale=0.3, tone=0.15, amount=0.4, colors=None, seed=None)"),
        pattern!(Plaster, "plaster(scale=0.1, tone=0.05, amount=0.3, colors=None, seed=None)"),
        pattern!(
            Rattan,
            "rattan(pitch=0.012, kind=\"box\", tone=0.15, amount=0.5, turn=0, at=None, colors=None, seed=None)"
        ),
        pattern!(Corrugated, "corrugated(pitch=0.076, depth=None, turn=0, at=None, colors=None, seed=None)"),
        pattern!(
            Quilting,
            "quilting(cell=0.12, kind=\"diamond\", amount=0.5, turn=0, at=None, colors=None, seed=None)"
        ),
        pattern!(Grime, "grime(amount=0.3, scale=0.5, tone=0.2, colors=None, seed=None)"),
    ]
}

/// What a pattern is when nothing is said: width, length, joint, tone, amount, variant.
fn usual(kind: PatternKind) -> (f64, f64, f64, f64, f64, &'static str) {
    match kind {
        PatternKind::Planks => (0.14, 1.8, 0.001, 0.3, 0.5, "running"),
        PatternKind::Parquet => (0.07, 0.42, 0.001, 0.3, 0.5, "herringbone"),
        PatternKind::Tiles => (0.3, 0.0, 0.003, 0.1, 0.2, "stack"),
        PatternKind::Brick => (0.24, 0.071, 0.01, 0.4, 0.4, "running"),
        PatternKind::Checks => (0.1, 0.0, 0.0, 0.0, 0.0, ""),
        PatternKind::Stripes => (0.05, 0.0, 0.0, 0.0, 0.0, ""),
        PatternKind::Dots => (0.05, 0.0, 0.012, 0.0, 0.0, "diagonal"),
        PatternKind::Weave => (0.001, 0.0, 0.0, 0.1, 0.5, ""),
        PatternKind::Knit => (0.005, 0.0, 0.0, 0.1, 0.5, ""),
        PatternKind::Terry => (0.002, 0.0, 0.0, 0.1, 0.5, ""),
        PatternKind::Boucle => (0.004, 0.0, 0.0, 0.1, 0.5, ""),
        PatternKind::Pile => (0.002, 0.0, 0.0, 0.15, 0.5, ""),
        PatternKind::Leather => (0.002, 0.0, 0.0, 0.1, 0.5, ""),
        PatternKind::Wood => (0.1, 0.0, 0.0, 0.15, 0.5, ""),
        PatternKind::Marble => (0.4, 0.0, 0.0, 0.1, 0.4, ""),
        PatternKind::Terrazzo => (0.012, 0.0, 0.0, 0.3, 0.5, ""),
        PatternKind::Concrete => (0.3, 0.0, 0.0, 0.15, 0.4, ""),
        PatternKind::Plaster => (0.1, 0.0, 0.0, 0.05, 0.3, ""),
        PatternKind::Rattan => (0.012, 0.0, 0.0, 0.15, 0.5, "box"),
        PatternKind::Corrugated => (0.076, 0.0, 0.0, 0.0, 0.5, ""),
        PatternKind::Quilting => (0.12, 0.0, 0.0, 0.0, 0.5, "diamond"),
        PatternKind::Grime => (0.5, 0.0, 0.0, 0.2, 0.3, ""),
        PatternKind::Motif | PatternKind::Ramp | PatternKind::Over | PatternKind::Tint => (0.1, 0.0, 0.0, 0.0, 0.5, ""),
    }
}

const VARIANTS: [&str; 11] = [
    "running",
    "stack",
    "herringbone",
    "chevron",
    "diagonal",
    "box",
    "diamond",
    "channel",
    "straight",
    "basket",
    "hexagon",
];

fn sized<'v>(c: &mut Call<'v, '_>, kind: PatternKind) -> Outcome<'v> {
    let (width, length, joint, tone, amount, variant) = usual(kind);
    let mut pattern = Pattern { width, length, joint, tone, amount, variant: variant.to_owned(), ..Pattern::new(kind) };
    for name in ["w", "c", "pitch", "yarn", "gauge", "scale", "chip", "cell"] {
        if c.given(name).is_some() {
            pattern.width = c.need_number(name, LENGTH)?;
        }
    }
    for name in ["l", "h", "depth"] {
        if c.given(name).is_some() {
            pattern.length = c.need_number(name, LENGTH)?;
        }
    }
    for name in ["joint", "r"] {
        if c.given(name).is_some() {
            pattern.joint = c.need_number(name, 0.0..=5.0)?;
        }
    }
    match c.given("grain") {
        // Told by programs of old, and kept as it is told: grain follows the longest side of each part.
        Some(_) if kind == PatternKind::Wood => {
            c.word("grain", &["x", "y", "z", "length", "u", "v"], "y")?.clone_into(&mut pattern.variant);
        }
        Some(_) => pattern.width = c.need_number("grain", LENGTH)?,
        None if kind == PatternKind::Wood => "y".clone_into(&mut pattern.variant),
        None => {}
    }
    if c.given("kind").is_some() {
        c.word("kind", &VARIANTS, "running")?.clone_into(&mut pattern.variant);
    }
    pattern.tone = c.number("tone", tone, SHARE)?;
    pattern.amount = c.number("amount", amount, SHARE)?;
    common(c, pattern)
}

/// Turn, shift, colours and seed.
fn common<'v>(c: &mut Call<'v, '_>, mut pattern: Pattern) -> Outcome<'v> {
    pattern.turn_deg = c.number("turn", 0.0, ANGLE)?;
    // To the right and up the surface, whatever the turn; a pattern's own shift is along its u and v.
    let [right, up] = c.list("at", Some([0.0; 2]), -5.0..=5.0)?;
    let (sin, cos) = (libm::sin(pattern.turn_deg.to_radians()), libm::cos(pattern.turn_deg.to_radians()));
    pattern.offset = [right * cos - up * sin, -right * sin - up * cos].map(|o| o + 0.0);
    if let Some(value) = c.given("colors") {
        let list = match (items(value), color(value)) {
            (Some(list), None) => list.iter().map(|v| color(*v)).collect::<Option<Vec<_>>>(),
            (_, Some(one)) => Some(vec![one]),
            _ => None,
        };
        let list = list.filter(|l| l.len() <= 12);
        pattern.colors = list.ok_or_else(|| c.refuse("colors", value, "a list of colours \"#rrggbb\", at most 12"))?;
    }
    pattern.seed = c.seed()?;
    finish(c, pattern)
}

fn finish<'v>(c: &Call<'v, '_>, pattern: Pattern) -> Outcome<'v> {
    c.value(Kind::Pattern(Arc::new(pattern)))
}

fn need_color(c: &Call<'_, '_>, name: &str) -> Result<String, Complaint> {
    let value = c.need(name)?;
    color(value).ok_or_else(|| c.refuse(name, value, "a colour \"#rrggbb\""))
}

fn pattern_of(c: &Call<'_, '_>, name: &str) -> Result<Pattern, Complaint> {
    let value = c.need(name)?;
    match Thing::from_value(value).map(|t| &t.kind) {
        Some(Kind::Pattern(pattern)) => Ok((**pattern).clone()),
        _ => Err(c.refuse(name, value, "a pattern, such as planks() or weave()")),
    }
}

fn depth(pattern: &Pattern) -> u32 {
    1 + pattern.layers.iter().map(depth).max().unwrap_or(0)
}

fn layered<'v>(c: &mut Call<'v, '_>, kind: PatternKind) -> Outcome<'v> {
    let mut pattern = Pattern::new(kind);
    if kind == PatternKind::Over {
        pattern.layers = vec![pattern_of(c, "a")?, pattern_of(c, "b")?];
        // How opaque the first is, or a third pattern: the first where it is white, the second where it is black.
        match c.given("mask").and_then(Thing::from_value).map(|t| &t.kind) {
            Some(Kind::Pattern(mask)) => {
                pattern.amount = 1.0;
                pattern.layers.push((**mask).clone());
            }
            _ => pattern.amount = c.number("mask", 0.5, SHARE)?,
        }
    } else {
        pattern.layers = vec![pattern_of(c, "map")?];
        pattern.colors = vec![need_color(c, "color")?];
        pattern.amount = c.number("amount", 1.0, SHARE)?;
    }
    if depth(&pattern) > 5 {
        return Err(Complaint::limit("patterns are laid over one another more than 5 deep").into());
    }
    pattern.width = pattern.layers[0].width;
    finish(c, pattern)
}

fn mat<'v>(c: &mut Call<'v, '_>) -> Outcome<'v> {
    let name: String = c.text("name")?.unwrap_or("material").chars().take(60).collect();
    let mut spec = plain(&name, "#c0b8ac");
    if c.given("color").is_some() {
        spec.color = need_color(c, "color")?;
    }
    spec.rough = c.number("rough", 0.6, SHARE)?;
    spec.metal = c.number("metal", 0.0, SHARE)?;
    spec.sheen = c.number("sheen", 0.0, SHARE)?;
    spec.alpha = c.number("alpha", 1.0, SHARE)?;
    spec.transmission = c.number("transmission", 0.0, SHARE)?;
    spec.ior = c.number("ior", 1.45, 1.0..=2.5)?;
    spec.emit = c.number("emit", 0.0, 0.0..=1e6)?;
    if c.given("kelvin").is_some() {
        spec.kelvin = Some(c.need_number("kelvin", 1000.0..=20_000.0)?);
    }
    spec.bump = c.number("bump", 1.0, 0.0..=3.0)?;
    spec.paint = c.flag("paint", false)?;
    if let Some(value) = c.given("map") {
        match Thing::from_value(value).map(|t| &t.kind) {
            Some(Kind::Pattern(pattern)) => spec.map = Some((**pattern).clone()),
            Some(Kind::Photo(photo)) => spec.photo = Some((**photo).clone()),
            _ => return Err(c.refuse("map", value, "a pattern or photo(...)").into()),
        }
    }
    // A pattern's own first colour where the slot has none.
    if let (None, Some(first)) = (c.given("color"), spec.map.as_ref().and_then(|m| m.colors.first())) {
        spec.color.clone_from(first);
    }
    let index = c.session.material(spec)?;
    c.value(Kind::Material(index))
}

fn photo<'v>(c: &mut Call<'v, '_>) -> Outcome<'v> {
    let value = c.need("quad")?;
    let say = || {
        let allowed = "four corners (x, y) in thousandths of the photo, or [left, top, right, bottom]";
        c.refuse("quad", value, allowed)
    };
    let list = items(value).ok_or_else(say)?;
    let corners: Option<Vec<Vec<f64>>> = list.iter().map(|v| numbers(*v)).collect();
    let quad: [[f64; 2]; 4] = match (numbers(value).as_deref(), corners.as_deref()) {
        (Some(&[l, t, r, b]), _) => [[l, t], [r, t], [r, b], [l, b]],
        (_, Some([a, b, c, d])) => {
            let pair = |p: &Vec<f64>| <[f64; 2]>::try_from(p.clone()).map_err(|_| say());
            [pair(a)?, pair(b)?, pair(c)?, pair(d)?]
        }
        _ => return Err(say().into()),
    };
    if quad.iter().flatten().any(|x| !(-500.0..=1500.0).contains(x)) {
        return Err(say().into());
    }
    let photo = PhotoMap { quad, size: c.list("size", None, LENGTH)?, delit: c.flag("delit", false)? };
    c.value(Kind::Photo(Arc::new(photo)))
}
