//! Layouts from drawings: SVG of straight lines.
//!
//! Rooms are the elements of class `room`, or where there is none all `rect`, `polygon` and `path` with an `id`; their ids
//! are the rooms' names. Doors are elements of class `door` or `opening`: a line along the wall, or a rectangle in it.
//! Nested transforms are applied. An SVG has no trustworthy unit: the length of one is given, or stands as
//! `data-metres-per-unit` on the root.

use glam::{DAffine2, DVec2};
use harmony_scene::Wall;
use roxmltree::{Document, Node};
use svgtypes::{PointsParser, SimplePathSegment, SimplifyingPathParser, Transform};

use crate::HomeError;
use crate::layout::{DoorKind, HomeLayout, LAYOUT_VERSION, LayoutDoor, LayoutRoom, Unit};

/// Largest file that is read, bytes.
const MAX_BYTES: usize = 16 << 20;
/// Deepest nesting of elements.
const MAX_DEPTH: usize = 64;

/// What an SVG cannot say.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SvgOptions {
    /// Length of one unit of the drawing, metres.
    pub metres_per_unit: Option<f64>,
    /// Height of all rooms that have no `data-height`, metres.
    pub height: Option<f64>,
}

fn bad(why: impl Into<String>) -> HomeError {
    HomeError::Drawing { why: why.into() }
}

/// A shape of the drawing, in its units after all transforms.
struct Outline<'a> {
    node: Node<'a, 'a>,
    points: Vec<DVec2>,
}

/// Reads a drawing as a layout.
///
/// # Errors
/// [`HomeError::Drawing`] for what is no drawing, curves, or an unknown scale; [`HomeError::Layout`] for rooms and doors that
/// do not go together.
pub fn parse(text: &str, options: &SvgOptions) -> Result<HomeLayout, HomeError> {
    if text.len() > MAX_BYTES {
        return Err(bad(format!("it is larger than {} MB", MAX_BYTES >> 20)));
    }
    let document = Document::parse(text).map_err(|e| bad(e.to_string()))?;
    let root = document.root_element();
    if root.tag_name().name() != "svg" {
        return Err(bad(format!("its root is <{}>, not <svg>", root.tag_name().name())));
    }
    let stated = root.attribute("data-metres-per-unit").map(|v| number(v, "data-metres-per-unit")).transpose()?;
    let k = options.metres_per_unit.or(stated).ok_or_else(|| {
        bad("its scale is unknown: give the length of one unit in metres with --scale, or data-metres-per-unit")
    })?;
    if !(k.is_finite() && k > 0.0) {
        return Err(bad(format!("a unit of {k} m")));
    }
    let mut outlines = Vec::new();
    collect(root, DAffine2::from_scale(DVec2::splat(k)), 0, &mut outlines)?;
    let marked = outlines.iter().any(|o| has_class(o.node, "room"));
    let mut rooms = Vec::new();
    for outline in &outlines {
        let is_room = if marked {
            has_class(outline.node, "room")
        } else {
            outline.node.attribute("id").is_some() && door_kind(outline.node).is_none()
        };
        if !is_room || outline.points.len() < 4 {
            continue;
        }
        let id = outline.node.attribute("id").ok_or_else(|| bad("a room has no id: ids are the rooms' names"))?;
        let of = |name: &str| outline.node.attribute(name).map(|v| number(v, name)).transpose();
        rooms.push(LayoutRoom {
            name: id.to_lowercase().replace([' ', '-', '.'], "_"),
            polygon: outline.points.clone(),
            height: of("data-height")?.or(options.height),
            floor: of("data-floor")?.unwrap_or(0.0),
            ..LayoutRoom::empty(id)
        });
    }
    if rooms.is_empty() {
        return Err(bad("it has no room: rooms are rect, polygon or path elements with an id"));
    }
    let mut layout =
        HomeLayout { version: LAYOUT_VERSION, unit: Unit::Metre, wall_thickness: None, rooms, doors: Vec::new() };
    layout.check()?;
    for outline in &outlines {
        if let Some(kind) = door_kind(outline.node) {
            let door = door(&layout, outline, kind)?;
            layout.doors.push(door);
        }
    }
    layout.check()?;
    Ok(layout)
}

fn number(text: &str, what: &str) -> Result<f64, HomeError> {
    let value: Option<f64> = text.trim().parse().ok().filter(|v: &f64| v.is_finite());
    value.ok_or_else(|| bad(format!("{what} is {:?}, not a number", text.chars().take(40).collect::<String>())))
}

fn has_class(node: Node<'_, '_>, class: &str) -> bool {
    node.attribute("class").is_some_and(|c| c.split_whitespace().any(|c| c.eq_ignore_ascii_case(class)))
}

fn door_kind(node: Node<'_, '_>) -> Option<DoorKind> {
    if has_class(node, "door") { Some(DoorKind::Door) } else { has_class(node, "opening").then_some(DoorKind::Opening) }
}

/// All shapes below an element.
fn collect<'a>(
    node: Node<'a, 'a>,
    from_parent: DAffine2,
    depth: usize,
    out: &mut Vec<Outline<'a>>,
) -> Result<(), HomeError> {
    if depth > MAX_DEPTH {
        return Err(bad(format!("its elements are nested deeper than {MAX_DEPTH}")));
    }
    let own = match node.attribute("transform") {
        Some(text) => {
            let t: Transform = text.parse().map_err(|_| bad(format!("the transform {text:?} cannot be read")))?;
            from_parent * DAffine2::from_cols_array(&[t.a, t.b, t.c, t.d, t.e, t.f])
        }
        None => from_parent,
    };
    let name = node.tag_name().name();
    if matches!(name, "defs" | "symbol" | "clipPath" | "mask" | "pattern") {
        return Ok(());
    }
    let of = |name: &str| node.attribute(name).map_or(Ok(0.0), |v| number(v, name));
    let wanted = node.attribute("id").is_some() || has_class(node, "room") || door_kind(node).is_some();
    let points = match name {
        "rect" => {
            let (p, s) = (DVec2::new(of("x")?, of("y")?), DVec2::new(of("width")?, of("height")?));
            vec![p, p + s.with_y(0.0), p + s, p + s.with_x(0.0)]
        }
        "line" => vec![DVec2::new(of("x1")?, of("y1")?), DVec2::new(of("x2")?, of("y2")?)],
        "polygon" | "polyline" => {
            PointsParser::from(node.attribute("points").unwrap_or_default()).map(|(x, y)| DVec2::new(x, y)).collect()
        }
        "path" if wanted => path(node)?,
        _ => Vec::new(),
    };
    if wanted && points.len() > 1 {
        out.push(Outline { node, points: points.into_iter().map(|p| own.transform_point2(p)).collect() });
    }
    node.children().filter(Node::is_element).try_for_each(|child| collect(child, own, depth + 1, out))
}

/// The corners of a path of straight lines; its first contour only.
fn path(node: Node<'_, '_>) -> Result<Vec<DVec2>, HomeError> {
    let id = node.attribute("id").unwrap_or("without an id");
    let mut points = Vec::new();
    for segment in SimplifyingPathParser::from(node.attribute("d").unwrap_or_default()) {
        match segment.map_err(|e| bad(format!("the path {id}: {e}")))? {
            SimplePathSegment::MoveTo { .. } if points.len() > 1 => break,
            SimplePathSegment::MoveTo { x, y } => points = vec![DVec2::new(x, y)],
            SimplePathSegment::LineTo { x, y } => points.push(DVec2::new(x, y)),
            SimplePathSegment::ClosePath => break,
            _ => return Err(bad(format!("the path {id} has curves; walls are straight"))),
        }
    }
    Ok(points)
}

/// A door, in the walls that it is drawn in.
fn door(layout: &HomeLayout, outline: &Outline<'_>, kind: DoorKind) -> Result<LayoutDoor, HomeError> {
    let low = outline.points.iter().copied().fold(DVec2::INFINITY, DVec2::min);
    let high = outline.points.iter().copied().fold(DVec2::NEG_INFINITY, DVec2::max);
    let (at, width) = ((low + high) / 2.0, (high - low).max_element());
    let height = outline.node.attribute("data-height").map(|v| number(v, "data-height")).transpose()?;
    let named =
        outline.node.attribute("data-rooms").map(|r| r.split_whitespace().map(str::to_owned).collect::<Vec<_>>());
    let names: Vec<String> = layout.rooms.iter().map(|r| r.name.clone()).collect();
    let candidates: Vec<Vec<String>> = if let Some(rooms) = named {
        vec![rooms]
    } else {
        let after = |k: usize| names[k + 1..].iter();
        let pairs = names.iter().enumerate().flat_map(|(k, a)| after(k).map(|b| vec![a.clone(), b.clone()]));
        pairs.chain(names.iter().map(|n| vec![n.clone()])).collect()
    };
    let mut trial = layout.clone();
    for rooms in candidates {
        trial.doors = vec![LayoutDoor { rooms, at, width, height, kind }];
        if let Ok(sides) = trial.sides(0) {
            // A door lies along its wall.
            let upright = matches!(sides[0].side, Wall::Left | Wall::Right);
            if upright == (high.y - low.y >= high.x - low.x) {
                return Ok(trial.doors.remove(0));
            }
        }
    }
    let id = outline.node.attribute("id").unwrap_or("without an id");
    Err(bad(format!("the door {id} at ({:.2}, {:.2}) m lies in no wall along it", at.x, at.y)))
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLAN: &str = r#"<svg xmlns="http://www.w3.org/2000/svg" data-metres-per-unit="0.01">
        <g transform="translate(100 50)">
          <rect id="Kitchen" x="0" y="0" width="300" height="400" data-height="2.5"/>
          <path id="hall" d="M312 0 h288 v400 H400 V200 H312 z"/>
          <line class="door" x1="306" y1="60" x2="306" y2="150" data-height="2.0"/>
          <rect class="opening" x="600" y="250" width="10" height="120"/>
          <text id="title">Plan</text>
        </g></svg>"#;

    #[test]
    fn rooms_and_doors_come_out_of_nested_transforms_in_metres() {
        let layout = parse(PLAN, &SvgOptions { metres_per_unit: None, height: Some(2.6) }).unwrap();
        assert_eq!(layout.rooms.iter().map(|r| r.name.as_str()).collect::<Vec<_>>(), ["kitchen", "hall"]);
        let bounds = layout.rooms[0].bounds();
        assert!(
            (bounds.min - DVec2::new(1.0, 0.5)).length() < 1e-9 && (bounds.max - DVec2::new(4.0, 4.5)).length() < 1e-9
        );
        assert_eq!((layout.rooms[0].height, layout.rooms[1].height), (Some(2.5), Some(2.6)));
        let free: f64 = layout.rooms[1].free().iter().map(crate::frame::Rect::area).sum();
        assert!((free - (2.88 * 4.0 - 0.88 * 2.0)).abs() < 1e-9);
        let [a, b] = &layout.doors[..] else { panic!("{:?}", layout.doors) };
        assert_eq!((a.rooms.join("-"), a.kind, a.height), ("kitchen-hall".to_owned(), DoorKind::Door, Some(2.0)));
        assert!((a.width - 0.9).abs() < 1e-9 && (a.at - DVec2::new(4.06, 1.55)).length() < 1e-9);
        assert_eq!((b.rooms.join("-"), b.kind), ("hall".to_owned(), DoorKind::Opening));
        assert!((b.width - 1.2).abs() < 1e-9);
    }

    #[test]
    fn what_is_no_layout_is_refused_with_the_reason() {
        let refused = |text: &str| parse(text, &SvgOptions::default()).unwrap_err().to_string();
        assert!(refused("not xml").contains("cannot be read"));
        assert!(refused("<html/>").contains("<html>"));
        assert!(refused("<svg><rect id='a' width='3' height='4'/></svg>").contains("--scale"));
        let scaled = |inside: &str| refused(&format!("<svg data-metres-per-unit='1'>{inside}</svg>"));
        assert!(scaled("").contains("no room"));
        assert!(scaled("<path id='a' d='M0 0 C1 1 2 2 3 3 z'/>").contains("curves"));
        assert!(scaled("<rect id='a' width='x' height='4'/>").contains("not a number"));
        assert!(
            scaled("<rect id='a' width='3' height='4'/><line class='door' x1='9' y1='9' x2='9.9' y2='9'/>")
                .contains("no wall")
        );
        assert!(scaled("<g transform='rotate(30)'><rect id='a' width='3' height='4'/></g>").contains("axes"));
    }

    proptest::proptest! {
        #[test]
        fn any_text_is_a_layout_or_an_error(text in "[<>/svgrectidM0-9 ='\"lLhz.-]{0,120}") {
            let _ = parse(&text, &SvgOptions { metres_per_unit: Some(1.0), height: None });
        }
    }
}
