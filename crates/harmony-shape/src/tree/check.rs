//! Whether a tree can be meshed, and what it would cost.

use super::{
    Along, Curve, Kind, LoftSection, MAX_COORDINATE, MAX_INSTANCES, MAX_MATERIALS, MAX_NODES, MAX_POINTS, Node,
    Outline, PlantKind, Section, ShapeTree, TreeError,
};

/// Most triangles of a tree, as estimated before it is meshed.
pub const MAX_TRIANGLES: u64 = 1_500_000;
/// Most children that a node may name in all.
const MAX_CHILDREN: usize = 50_000;
/// Smallest length, metres.
const SMALL: f64 = 1e-5;

impl ShapeTree {
    /// Checks a tree as if a stranger had written it: order, materials, numbers and their ranges, counts, copies once they
    /// are expanded, and about how many triangles it would have.
    ///
    /// # Errors
    /// The first thing that is wrong, with the line of the program and what would do.
    pub fn check(&self) -> Result<(), TreeError> {
        if self.nodes.is_empty() {
            return Err(TreeError::Empty);
        }
        many("nodes", self.nodes.len() as u64, MAX_NODES as u64)?;
        many("materials", self.materials.len() as u64, MAX_MATERIALS as u64)?;
        let mut points = 0_u64;
        let mut children = 0_u64;
        for (i, node) in self.nodes.iter().enumerate() {
            let references = node.kind.references();
            children += references.len() as u64;
            for r in references {
                if r.0 as usize >= i {
                    return Err(TreeError::Order { node: i as u32, child: r.0, line: node.line });
                }
            }
            self.materials_of(node)?;
            numbers(node)?;
            points += point_count(&node.kind);
        }
        many("references to children", children, MAX_CHILDREN as u64)?;
        many("points of curves, outlines, grids and meshes", points, MAX_POINTS as u64)?;
        self.cost()
    }

    fn materials_of(&self, node: &Node) -> Result<(), TreeError> {
        let extra = match &node.kind {
            Kind::Paint { with, .. } | Kind::Decal { with, .. } => Some(*with),
            Kind::Plant { flower, .. } => *flower,
            _ => None,
        };
        for material in node.material.into_iter().chain(extra) {
            if material as usize >= self.materials.len() {
                return Err(TreeError::Material { material, line: node.line });
            }
        }
        Ok(())
    }

    /// Instances and triangles of each node.
    fn estimates(&self) -> Vec<(u64, u64)> {
        let mut out: Vec<(u64, u64)> = Vec::with_capacity(self.nodes.len());
        for node in &self.nodes {
            let of = |id: &super::NodeId| out.get(id.0 as usize).copied().unwrap_or((0, 0));
            let sum = |list: &[super::NodeId]| {
                list.iter().map(of).fold((0_u64, 0_u64), |a, b| (a.0.saturating_add(b.0), a.1.saturating_add(b.1)))
            };
            let times = |a: (u64, u64), n: u64| (a.0.saturating_mul(n), a.1.saturating_mul(n));
            let own = own_triangles(&node.kind);
            let entry = match &node.kind {
                Kind::Group { children } | Kind::Stack { children, .. } => sum(children),
                Kind::Placed { child, .. }
                | Kind::Joint { child, .. }
                | Kind::Paint { child, .. }
                | Kind::On { child, .. }
                | Kind::Against { child, .. } => of(child),
                Kind::Copies { child, places } => times(of(child), places.len() as u64),
                Kind::Scatter { children, count, .. } => {
                    times(sum(children), u64::from(*count).div_ceil(children.len().max(1) as u64))
                }
                Kind::Boolean { a, b, .. } => (of(a).0.max(1), of(a).1.saturating_add(of(b).1).saturating_mul(2)),
                Kind::Shell { child, .. } => times(of(child), 1).map_triangles(4),
                Kind::Slump { child, .. } => of(child).map_triangles(1),
                Kind::Tuft { child, .. }
                | Kind::Quilt { child, .. }
                | Kind::Fuzz { child, .. }
                | Kind::Decal { child, .. } => {
                    let c = of(child);
                    (c.0 + 1, c.1.saturating_add(own))
                }
                Kind::Wicker { child, .. } => (of(child).0, own.saturating_mul(of(child).0.max(1))),
                Kind::Light { .. } | Kind::Surface { .. } => (0, 0),
                _ => (1, own),
            };
            out.push(entry);
        }
        out
    }

    fn cost(&self) -> Result<(), TreeError> {
        let estimates = self.estimates();
        let Some((instances, triangles)) = estimates.last().copied() else { return Ok(()) };
        // a node that is built is paid for even when the root does not show it
        let built: u64 = self.nodes.iter().map(|n| own_triangles(&n.kind)).fold(0, u64::saturating_add);
        let most = estimates.iter().map(|e| e.0).max().unwrap_or(instances);
        many("pieces once copies are expanded", most, MAX_INSTANCES)?;
        let worst = triangles.max(built);
        if worst > MAX_TRIANGLES {
            let heaviest =
                (0..self.nodes.len()).max_by_key(|i| (own_triangles(&self.nodes[*i].kind), std::cmp::Reverse(*i)));
            let line = heaviest.map_or(0, |i| self.nodes[i].line);
            return Err(TreeError::Shape {
                message: format!(
                    "about {worst} triangles; at most {MAX_TRIANGLES} are allowed: make fewer copies, or coarser ones"
                ),
                line,
            });
        }
        Ok(())
    }
}

/// Scales the second of a pair.
trait MapTriangles {
    fn map_triangles(self, n: u64) -> Self;
}

impl MapTriangles for (u64, u64) {
    fn map_triangles(self, n: u64) -> Self {
        (self.0, self.1.saturating_mul(n))
    }
}

fn many(what: &'static str, count: u64, max: u64) -> Result<(), TreeError> {
    if count > max { Err(TreeError::TooMany { what, count, max }) } else { Ok(()) }
}

fn outline_points(o: &Outline) -> u64 {
    let own = o.points.len() + o.holes.iter().map(Vec::len).sum::<usize>();
    own as u64 + o.islands.iter().map(outline_points).sum::<u64>()
}

fn section_points(s: &Section) -> u64 {
    match s {
        Section::Round(_) => 0,
        Section::Outline(o) => outline_points(o),
    }
}

fn point_count(kind: &Kind) -> u64 {
    match kind {
        Kind::Copies { places, .. } => places.len() as u64,
        Kind::Lathe { profile, .. } | Kind::BentSheet { profile, .. } => profile.len() as u64,
        Kind::Extrude { outline, .. } | Kind::WireNet { outline, .. } => outline_points(outline),
        Kind::Sweep { curve, section, .. } => curve.points.len() as u64 + section_points(section),
        Kind::Braid { curve, .. } | Kind::Fringe { along: Along::Curve(curve), .. } => curve.points.len() as u64,
        Kind::Loft { sections, .. } => sections.iter().map(|s| outline_points(&s.outline)).sum(),
        Kind::Surf { points, .. } => points.len() as u64,
        Kind::Mesh { points, faces } => (points.len() + faces.iter().map(Vec::len).sum::<usize>()) as u64,
        _ => 0,
    }
}

fn around(radius: f64) -> f64 {
    crate::solid::math::divisions(radius.clamp(0.0, MAX_COORDINATE)) as f64
}

fn length(curve: &Curve) -> f64 {
    let step = |w: &[[f64; 3]]| {
        let d: [f64; 3] = std::array::from_fn(|k| w[1][k] - w[0][k]);
        (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt()
    };
    curve.points.windows(2).map(step).sum()
}

/// Rough upper guess of a node's own triangles.
fn own_triangles(kind: &Kind) -> u64 {
    let n = match kind {
        Kind::Box { segments, .. } => f64::from(*segments + 2) * f64::from(*segments + 2) * 12.0,
        Kind::Cylinder { radius, top_radius, .. } => around(radius.max(*top_radius)) * 24.0,
        Kind::Sphere { radii } => {
            let n = around(radii[0].max(radii[1]).max(radii[2]));
            n * n
        }
        Kind::Lathe { profile, lobes, wall, .. } => {
            let r = profile.iter().map(|p| p[0]).fold(0.0, f64::max);
            let sides = around(r).max(f64::from(*lobes) * 8.0);
            sides * 2.0 * profile.len() as f64 * if *wall > 0.0 { 2.0 } else { 1.0 }
        }
        Kind::Extrude { outline, bend_deg, twist_deg, bevel, .. } => {
            let rows = 1.0 + bend_deg.abs().max(twist_deg.abs()) / 5.0 + if *bevel > 0.0 { 8.0 } else { 0.0 };
            outline_points(outline) as f64 * (2.0 * rows.min(100.0) + 2.0)
        }
        Kind::Sweep { curve, section, rings, twist_deg, .. } => {
            let across = match section {
                Section::Round(r) => around(*r),
                Section::Outline(o) => outline_points(o) as f64,
            };
            let rows = curve.points.len() as f64
                + if rings[0] > 0.0 { (length(curve) * 6.0 / rings[0]).min(3000.0) } else { 0.0 }
                + (twist_deg.abs() / 6.0).min(3000.0)
                + 10.0;
            across * 2.0 * rows
        }
        Kind::Loft { sections, .. } => 320.0 * sections.len() as f64,
        Kind::BentSheet { profile, .. } => 8.0 * profile.len() as f64,
        Kind::Surf { points, thick, .. } => points.len() as f64 * if *thick > 0.0 { 4.0 } else { 2.0 },
        Kind::Mesh { faces, .. } => faces.iter().map(|f| f.len().saturating_sub(2)).sum::<usize>() as f64,
        Kind::Blend { .. } => 20_000.0,
        Kind::Pillow { piping, .. } => 6_000.0 + if *piping > 0.0 { 2_500.0 } else { 0.0 },
        Kind::Cushion { .. } => 4_000.0,
        Kind::Tuft { rows, cols, .. } => 8_000.0 + f64::from(*rows) * f64::from(*cols) * 150.0,
        Kind::Quilt { .. } => 15_000.0,
        Kind::Drape { size, .. } => (size[0] * size[1] / 2.56e-4).min(8_000.0) * 4.0 * 4.0,
        Kind::Hang { size, folds, .. } => (f64::from(*folds).max(size[0] * 8.0) * 24.0 * 40.0 * 2.0).min(60_000.0),
        Kind::Roll { turns, .. } => 200.0 + turns * 200.0,
        Kind::Folded { layers, .. } => 800.0 + f64::from(*layers) * 400.0,
        Kind::Fringe { along, length: reach, spacing, fringe, .. } => {
            let edge = match along {
                Along::Curve(c) => length(c),
                Along::Hem { .. } => 2.5,
            };
            let each = match fringe {
                super::FringeKind::Tassel => 300.0,
                super::FringeKind::Pompom => 250.0,
                _ => 24.0,
            };
            edge / spacing.max(0.001) * each + reach
        }
        Kind::Fuzz { density, .. } => 40_000.0 * density.clamp(0.05, 1.0),
        Kind::Braid { curve, strands, pitch, .. } => {
            f64::from(*strands) * 2.0 * 8.0 * (curve.points.len() as f64 + length(curve) / pitch.max(0.001) * 16.0)
        }
        Kind::Wicker { cell, .. } => (0.5 / (cell.max(0.002) * cell.max(0.002)) * 16.0).min(60_000.0),
        Kind::WireNet { outline, pitch, .. } => {
            let (w, h) = extent(outline);
            (w + h) / pitch.max(0.001) * 60.0
        }
        Kind::Leaf { .. } => 60.0,
        Kind::Plant { plant, count, .. } => {
            let each = match plant {
                PlantKind::Fern | PlantKind::Palm => 600.0,
                PlantKind::Tree | PlantKind::Flowers | PlantKind::Vine => 200.0,
                _ => 100.0,
            };
            f64::from(if *count == 0 { 60 } else { *count }) * each
        }
        Kind::Template { .. } | Kind::PartModel { .. } => 8_000.0,
        Kind::Decal { size, .. } => (size[0] / 0.008).clamp(1.0, 48.0) * (size[1] / 0.008).clamp(1.0, 48.0) * 2.0,
        _ => 0.0,
    };
    if n.is_finite() { n.max(0.0) as u64 } else { u64::MAX }
}

fn extent(o: &Outline) -> (f64, f64) {
    let over = |k: usize| {
        let lo = o.points.iter().map(|p| p[k]).fold(f64::INFINITY, f64::min);
        let hi = o.points.iter().map(|p| p[k]).fold(f64::NEG_INFINITY, f64::max);
        (hi - lo).max(0.0)
    };
    (over(0), over(1))
}

/// Looks at the numbers of one node.
struct Numbers {
    line: u32,
}

impl Numbers {
    fn within(&self, what: &str, value: f64, low: f64, high: f64) -> Result<(), TreeError> {
        if value.is_finite() && (low..=high).contains(&value) {
            return Ok(());
        }
        let allowed = format!("it must lie between {low} and {high}");
        Err(TreeError::Number { what: what.to_owned(), value, allowed, line: self.line })
    }

    /// A length that must not be 0, metres.
    fn length(&self, what: &str, value: f64) -> Result<(), TreeError> {
        self.within(what, value, SMALL, MAX_COORDINATE)
    }

    /// A length that may be 0, metres.
    fn thickness(&self, what: &str, value: f64) -> Result<(), TreeError> {
        self.within(what, value, 0.0, MAX_COORDINATE)
    }

    fn share(&self, what: &str, value: f64) -> Result<(), TreeError> {
        self.within(what, value, 0.0, 1.0)
    }

    fn angle(&self, what: &str, value: f64) -> Result<(), TreeError> {
        self.within(what, value, -36_000.0, 36_000.0)
    }

    fn lengths(&self, what: &str, values: &[f64]) -> Result<(), TreeError> {
        values.iter().try_for_each(|v| self.length(what, *v))
    }

    fn points<const N: usize>(&self, what: &str, points: &[[f64; N]]) -> Result<(), TreeError> {
        points.iter().flatten().try_for_each(|v| self.within(what, *v, -MAX_COORDINATE, MAX_COORDINATE))
    }

    fn count(&self, what: &str, value: u32, low: u32, high: u32) -> Result<(), TreeError> {
        self.within(what, f64::from(value), f64::from(low), f64::from(high))
    }

    fn outline(&self, what: &str, o: &Outline, depth: u32) -> Result<(), TreeError> {
        if depth > 8 {
            return Err(self.shape("islands of an outline are nested too deeply; 8 levels are allowed"));
        }
        if o.points.len() < 3 && o.islands.is_empty() {
            return Err(self.shape(&format!("{what} has {} points; an outline needs at least 3", o.points.len())));
        }
        self.points(what, &o.points)?;
        o.holes.iter().try_for_each(|h| self.points(what, h))?;
        o.islands.iter().try_for_each(|i| self.outline(what, i, depth + 1))
    }

    fn curve(&self, what: &str, c: &Curve) -> Result<(), TreeError> {
        if c.points.len() < 2 {
            return Err(self.shape(&format!("{what} has {} points; a curve needs at least 2", c.points.len())));
        }
        self.points(what, &c.points)
    }

    fn columns(&self, columns: &[[f64; 3]; 4]) -> Result<(), TreeError> {
        self.points("a place", columns)
    }

    fn some(&self, what: &str, n: usize) -> Result<(), TreeError> {
        if n == 0 { Err(self.shape(&format!("{what} has nothing in it"))) } else { Ok(()) }
    }

    fn shape(&self, message: &str) -> TreeError {
        TreeError::Shape { message: message.to_owned(), line: self.line }
    }
}

fn numbers(node: &Node) -> Result<(), TreeError> {
    let n = Numbers { line: node.line };
    match &node.kind {
        // an empty list of parts is a loop that ran zero times
        Kind::Group { .. } => Ok(()),
        Kind::Placed { columns, .. } => n.columns(columns),
        Kind::Copies { places, .. } => places.iter().try_for_each(|p| n.columns(p)),
        Kind::On { u, v, .. } => n.within("u", *u, -1.0, 2.0).and(n.within("v", *v, -1.0, 2.0)),
        Kind::Against { .. } => Ok(()),
        Kind::Scatter { children, count, gap, .. } => {
            n.some("scatter", children.len())?;
            n.count("n", *count, 0, MAX_INSTANCES as u32)?;
            n.thickness("gap", *gap)
        }
        Kind::Stack { gap, jitter, .. } => n.within("gap", *gap, -1.0, 10.0).and(n.share("jitter", *jitter)),
        Kind::Box { size, bevel, segments, taper, shear } => {
            n.lengths("size of a box", size)?;
            n.thickness("bevel", *bevel)?;
            n.count("seg", *segments, 1, 8)?;
            taper.iter().try_for_each(|t| n.within("taper", *t, 0.0, 20.0))?;
            n.points("shear", std::slice::from_ref(shear))
        }
        Kind::Cylinder { radius, height, top_radius, bevel, sides, wall } => {
            n.thickness("r", *radius)?;
            n.thickness("r2", *top_radius)?;
            n.length("the larger radius", radius.max(*top_radius))?;
            n.length("h", *height)?;
            n.thickness("bevel", *bevel)?;
            n.thickness("wall", *wall)?;
            if matches!(sides, 1 | 2) { n.count("sides", *sides, 3, 256) } else { n.count("sides", *sides, 0, 256) }
        }
        Kind::Sphere { radii } => n.lengths("r of a sphere", radii),
        Kind::Lathe { profile, smooth_deg, wall, oval, lobes, lobe_depth } => {
            n.points("profile", profile)?;
            profile.iter().try_for_each(|p| n.thickness("a radius of the profile", p[0]))?;
            n.within("smooth", *smooth_deg, 0.0, 180.0)?;
            n.thickness("wall", *wall)?;
            n.within("oval", *oval, 0.01, 100.0)?;
            n.count("lobes", *lobes, 0, 200)?;
            n.within("lobe_depth", *lobe_depth, 0.0, 0.95)
        }
        Kind::Extrude { outline, depth, bevel, bend_deg, twist_deg, .. } => {
            n.outline("outline", outline, 0)?;
            n.length("depth", *depth)?;
            n.thickness("bevel", *bevel)?;
            n.within("bend", *bend_deg, -720.0, 720.0)?;
            n.angle("twist", *twist_deg)
        }
        Kind::Sweep { curve, section, taper, twist_deg, rings, .. } => {
            n.curve("curve", curve)?;
            match section {
                Section::Round(r) => n.length("r of a sweep", *r)?,
                Section::Outline(o) => n.outline("section", o, 0)?,
            }
            n.within("taper", *taper, 0.0, 100.0)?;
            n.angle("twist", *twist_deg)?;
            n.thickness("pitch of the rings", rings[0])?;
            n.thickness("depth of the rings", rings[1])
        }
        Kind::Loft { sections, .. } => sections.iter().try_for_each(|LoftSection { outline, at, turn_deg }| {
            n.outline("a section of a loft", outline, 0)?;
            n.points("place of a section", std::slice::from_ref(at))?;
            turn_deg.iter().try_for_each(|t| n.angle("turn of a section", *t))
        }),
        Kind::BentSheet { profile, width, thick, .. } => {
            n.points("profile", profile)?;
            n.length("width", *width)?;
            n.thickness("thick", *thick)
        }
        Kind::Surf { points, thick, .. } => n.points("a point", points).and(n.thickness("thick", *thick)),
        Kind::Mesh { points, faces } => {
            n.points("a point", points)?;
            many("faces of one mesh", faces.len() as u64, 20_000)
        }
        Kind::Blend { children, radius } => {
            n.some("blend", children.len())?;
            many("solids of a blend", children.len() as u64, 200)?;
            n.thickness("k", *radius)
        }
        Kind::Boolean { .. } => Ok(()),
        Kind::Shell { wall, .. } => n.length("wall", *wall),
        Kind::Pillow { size, wrinkle, piping, ears, dent, .. } => {
            n.lengths("size of a pillow", size)?;
            n.share("wrinkle", *wrinkle)?;
            n.within("piping", *piping, 0.0, 0.2)?;
            n.share("ears", *ears)?;
            n.share("dent", *dent)
        }
        Kind::Cushion { size, crown, sag, piping, bevel } => {
            n.lengths("size of a cushion", size)?;
            n.thickness("crown", *crown)?;
            n.thickness("sag", *sag)?;
            n.within("piping", *piping, 0.0, 0.2)?;
            n.thickness("bevel", *bevel)
        }
        Kind::Tuft { rows, cols, depth, button, .. } => {
            n.count("rows", *rows, 1, 60)?;
            n.count("cols", *cols, 1, 60)?;
            n.within("depth", *depth, 0.0, 1.0)?;
            n.within("button", *button, 0.0, 0.2)
        }
        Kind::Quilt { cell, depth, .. } => n.within("cell", *cell, 0.01, 5.0).and(n.within("depth", *depth, 0.0, 0.3)),
        Kind::Drape { size, at, turn_deg, rumple, thick, fold, stiff, .. } => {
            n.lengths("size of a cloth", size)?;
            n.points("at", std::slice::from_ref(at))?;
            n.angle("turn", *turn_deg)?;
            n.share("rumple", *rumple)?;
            n.within("thick", *thick, 0.0, 0.5)?;
            n.thickness("fold", *fold)?;
            n.share("stiff", *stiff)
        }
        Kind::Hang { size, folds, gather, tie, .. } => {
            n.lengths("size of a curtain", size)?;
            n.count("folds", *folds, 0, 200)?;
            n.within("gather", *gather, 1.0, 5.0)?;
            n.share("tie", *tie)
        }
        Kind::Slump { amount, .. } => n.share("amount", *amount),
        Kind::Roll { width, radius, turns, thick } => {
            n.length("w of a roll", *width)?;
            n.length("r of a roll", *radius)?;
            n.within("turns", *turns, 0.0, 60.0)?;
            n.thickness("thick", *thick)
        }
        Kind::Folded { size, layers, thick, .. } => {
            n.lengths("size of a folded cloth", size)?;
            n.count("layers", *layers, 1, 100)?;
            n.length("thick", *thick)
        }
        Kind::Fringe { along, length, spacing, jitter, .. } => {
            if let Along::Curve(c) = along {
                n.curve("curve", c)?;
            }
            n.length("length", *length)?;
            n.within("spacing", *spacing, 0.001, MAX_COORDINATE)?;
            n.share("jitter", *jitter)
        }
        Kind::Fuzz { length, density, .. } => n.within("length", *length, 1e-4, 0.5).and(n.share("density", *density)),
        Kind::Braid { curve, radius, strands, pitch } => {
            n.curve("curve", curve)?;
            n.length("r", *radius)?;
            n.count("strands", *strands, 2, 24)?;
            n.within("pitch", *pitch, 0.001, MAX_COORDINATE)
        }
        Kind::Wicker { cell, radius, .. } => n.within("cell", *cell, 0.002, 1.0).and(n.within("r", *radius, 2e-4, 0.2)),
        Kind::WireNet { outline, pitch, radius } => {
            n.outline("outline", outline, 0)?;
            n.within("pitch", *pitch, 0.002, 10.0)?;
            n.within("r", *radius, 1e-4, 0.2)
        }
        Kind::Leaf { size, fold_deg, curl_deg, .. } => {
            n.lengths("size of a leaf", size)?;
            n.within("fold", *fold_deg, -180.0, 180.0)?;
            n.within("curl", *curl_deg, -720.0, 720.0)
        }
        Kind::Plant { height, spread, count, .. } => {
            n.length("h of a plant", *height)?;
            n.length("spread of a plant", *spread)?;
            n.count("n", *count, 0, 2000)
        }
        Kind::Joint { axis, pivot, range, .. } => {
            n.points("axis", std::slice::from_ref(axis))?;
            n.points("pivot", std::slice::from_ref(pivot))?;
            if axis.iter().all(|v| *v == 0.0) {
                return Err(n.shape("the axis of a joint must not be (0, 0, 0)"));
            }
            range.iter().try_for_each(|v| n.within("range", *v, -3600.0, 3600.0))
        }
        Kind::Light { lumens, kelvin, radius, cone_deg, at, dir, .. } => {
            n.within("lumens", *lumens, 0.0, 1e6)?;
            n.within("kelvin", *kelvin, 800.0, 30_000.0)?;
            n.within("radius", *radius, 0.0, 10.0)?;
            n.within("cone", *cone_deg, 0.0, 360.0)?;
            n.points("at", std::slice::from_ref(at))?;
            n.points("dir", std::slice::from_ref(dir))
        }
        Kind::Surface { size, at } => {
            n.lengths("size of a surface", size).and(n.points("at", std::slice::from_ref(at)))
        }
        Kind::Template { size, .. } => size.iter().try_for_each(|v| n.within("size of a template", *v, 0.0, 50.0)),
        Kind::PartModel { size, .. } => size.iter().try_for_each(|v| n.within("size of a part model", *v, 0.001, 50.0)),
        Kind::Paint { .. } => Ok(()),
        Kind::Decal { at, size, .. } => {
            at.iter().try_for_each(|v| n.share("at", *v))?;
            n.lengths("size of a decal", size)
        }
    }
}
