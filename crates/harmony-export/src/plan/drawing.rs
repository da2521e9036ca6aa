//! A drawing in metres: marks on layers, without a file format.
//!
//! x to the right, y up, at true size; paper sizes (line widths, letters) are millimetres, times the drawing's scale.

use glam::DVec2;

/// Layers, as CAD programs have them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Layer {
    /// Walls that the photo shows.
    Walls,
    /// Walls that come from prior knowledge.
    WallsAssumed,
    /// Windows and doors.
    Openings,
    /// Outlines of furniture.
    Furniture,
    /// Lines inside outlines.
    Details,
    /// What hangs on walls.
    WallMounted,
    /// What hangs above, dashed in plan.
    Ceiling,
    /// What stands on furniture.
    Decoration,
    /// Dimensions.
    Dimensions,
    /// Labels.
    Text,
    /// The photo's camera.
    Camera,
    /// Frame, title, tables, scale bar.
    Sheet,
}

impl Layer {
    /// All.
    pub const ALL: [Self; 12] = [
        Self::Walls,
        Self::WallsAssumed,
        Self::Openings,
        Self::Furniture,
        Self::Details,
        Self::WallMounted,
        Self::Ceiling,
        Self::Decoration,
        Self::Dimensions,
        Self::Text,
        Self::Camera,
        Self::Sheet,
    ];

    /// Name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Walls => "WALLS",
            Self::WallsAssumed => "WALLS_ASSUMED",
            Self::Openings => "OPENINGS",
            Self::Furniture => "FURNITURE",
            Self::Details => "DETAILS",
            Self::WallMounted => "WALL_MOUNTED",
            Self::Ceiling => "CEILING",
            Self::Decoration => "DECORATION",
            Self::Dimensions => "DIMENSIONS",
            Self::Text => "TEXT",
            Self::Camera => "CAMERA",
            Self::Sheet => "SHEET",
        }
    }

    /// Width of its lines on paper, millimetres.
    pub fn width_mm(self) -> f64 {
        match self {
            Self::Walls => 0.5,
            Self::WallsAssumed => 0.35,
            Self::Openings | Self::Furniture => 0.3,
            Self::WallMounted | Self::Decoration | Self::Ceiling => 0.2,
            Self::Camera | Self::Sheet => 0.2,
            Self::Details | Self::Dimensions | Self::Text => 0.13,
        }
    }

    /// Whether its lines are dashed.
    pub fn dashed(self) -> bool {
        matches!(self, Self::Ceiling | Self::WallsAssumed)
    }

    /// Colour: sRGB on the page, and its number among the 255 of CAD programs.
    pub fn color(self) -> (&'static str, u8) {
        match self {
            Self::Camera => ("#b3261e", 1),
            Self::Dimensions => ("#444444", 8),
            Self::Details => ("#555555", 8),
            Self::Ceiling => ("#355f8a", 5),
            Self::Decoration => ("#4a4a4a", 9),
            _ => ("#111111", 7),
        }
    }
}

/// Which point of a text is given; vertically its middle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Anchor {
    Left,
    Middle,
    Right,
}

/// A mark; lengths in metres.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Shape {
    /// A line through points.
    Line { points: Vec<DVec2>, closed: bool },
    /// A filled area, sRGB.
    Area { points: Vec<DVec2>, fill: &'static str },
    /// An arc, radians anticlockwise from +x.
    Arc { centre: DVec2, radius: f64, from: f64, to: f64 },
    /// A circle.
    Circle { centre: DVec2, radius: f64 },
    /// A text, its angle in radians.
    Text { at: DVec2, height: f64, anchor: Anchor, angle: f64, text: String },
    /// A dimension between two points: what is measured, and the line that it is written on.
    Dimension { a: DVec2, b: DVec2, line: [DVec2; 2], text: String },
}

/// A mark on its layer.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Mark {
    pub layer: Layer,
    pub shape: Shape,
    /// Dashed although its layer is not.
    pub dashed: bool,
    /// Width instead of the layer's, millimetres.
    pub width_mm: Option<f64>,
}

/// Marks in drawing order, later ones over earlier ones.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Drawing {
    /// Title of the file.
    pub title: String,
    /// The scale: one metre of the drawing is `1 / scale` metres of paper.
    pub scale: f64,
    /// Lower left and upper right corner of the sheet, metres of the drawing.
    pub sheet: [DVec2; 2],
    /// Marks.
    pub marks: Vec<Mark>,
}

/// Mean width of a letter by its height.
pub(crate) const LETTER: f64 = 0.56;
/// Distance of dimension lines, and size of their ticks and letters, millimetres.
const TICK_MM: f64 = 1.6;
/// Height of the letters of dimensions, millimetres.
pub(crate) const DIMENSION_TEXT_MM: f64 = 2.2;

impl Drawing {
    /// Metres of the drawing for millimetres of paper.
    pub fn mm(&self, millimetres: f64) -> f64 {
        millimetres / 1000.0 * self.scale
    }

    pub fn add(&mut self, layer: Layer, shape: Shape) -> &mut Mark {
        let at = self.marks.len();
        self.marks.push(Mark { layer, shape, dashed: false, width_mm: None });
        &mut self.marks[at]
    }

    pub fn line(&mut self, layer: Layer, points: &[DVec2]) -> &mut Mark {
        self.add(layer, Shape::Line { points: points.to_vec(), closed: false })
    }

    pub fn closed(&mut self, layer: Layer, points: &[DVec2]) -> &mut Mark {
        self.add(layer, Shape::Line { points: points.to_vec(), closed: true })
    }

    pub fn text(&mut self, layer: Layer, at: DVec2, height_mm: f64, anchor: Anchor, text: impl Into<String>) {
        let height = self.mm(height_mm);
        self.add(layer, Shape::Text { at, height, anchor, angle: 0.0, text: text.into() });
    }

    /// A dimension of `a` to `b`, written `offset` metres to the left of the way from `a` to `b`.
    pub fn dimension(&mut self, a: DVec2, b: DVec2, offset: f64) {
        let Some(along) = (b - a).try_normalize() else { return };
        let side = along.perp() * offset;
        let text = format!("{:.2}", (b - a).length());
        self.add(Layer::Dimensions, Shape::Dimension { a, b, line: [a + side, b + side], text });
    }
}

/// The plain marks of a dimension: lines to what is measured, the line between ticks, the number above it.
pub(crate) fn dimension_marks(drawing: &Drawing, a: DVec2, b: DVec2, line: [DVec2; 2], text: &str) -> Vec<Shape> {
    let mm = |v: f64| drawing.mm(v);
    let along = (line[1] - line[0]).try_normalize().unwrap_or(DVec2::X);
    let mut out = Vec::new();
    for (from, to) in [(a, line[0]), (b, line[1])] {
        if let Some(way) = (to - from).try_normalize() {
            let gap = mm(1.2).min((to - from).length());
            out.push(Shape::Line { points: vec![from + way * gap, to + way * mm(1.2)], closed: false });
        }
    }
    out.push(Shape::Line { points: vec![line[0] - along * mm(1.2), line[1] + along * mm(1.2)], closed: false });
    let slash = (along + along.perp()).normalize_or(DVec2::ONE) * mm(TICK_MM) / 2.0;
    out.extend(line.map(|p| Shape::Line { points: vec![p - slash, p + slash], closed: false }));
    // Numbers are read from below or from the right.
    let mut angle = along.y.atan2(along.x);
    let mut up = along.perp();
    if angle > std::f64::consts::FRAC_PI_2 + 1e-9 || angle <= -std::f64::consts::FRAC_PI_2 + 1e-9 {
        angle += std::f64::consts::PI;
        up = -up;
    }
    let height = mm(DIMENSION_TEXT_MM);
    let wide = text.chars().count() as f64 * LETTER * height;
    let middle = (line[0] + line[1]) / 2.0;
    let free = (line[1] - line[0]).length();
    // A number that does not fit between the ticks stands beside them.
    let at = if wide > free * 0.95 { middle + up * height * 2.0 } else { middle + up * height * 0.85 };
    out.push(Shape::Text { at, height, anchor: Anchor::Middle, angle, text: text.to_owned() });
    out
}
