//! Cloth on what carries it (key `deco.drape`): a throw is modelled by itself, over an edge that is straight and level; the back
//! of a chair is rounded, and its upholstery comes out farther than the throw hangs.
//!
//! What lies on the host rises and sinks with the surface under it; what hangs down goes out, on its own side, as far as
//! the host comes out anywhere above: cloth hangs straight from where it last touches. Both are smooth fields over the
//! cloth, so that its thickness, its fringe and what is on it go along. Nothing here is simulated: the cloth stretches a
//! little, has no new folds, and what it lies on does not yield. Local frame: metres, the cloth's own axes, from its
//! position.

use std::sync::Arc;

use harmony_scene::{ObjectId, Pose, Support, Vec2, Vec3};

use crate::scene::attachment::{hang_of, sag_of, size_of};
use crate::scene::shape::HANG_COLUMNS;
use crate::scene::support::{lying_height, way_out};
use crate::{PartialScene, Placed, PlacementSettings, Shape, measure};

/// Step of the fields, metres, and their cells along one side, at most.
const CELL_M: f64 = 0.025;
const MAX_CELLS: usize = 64;
/// How far cloth sinks with what it lies on, and how far it rises, metres: beyond, that is not what it lies on but what it
/// leans on.
const LIFTS_M: [f64; 2] = [-0.06, 0.1];
/// ... and how far from the middle of all, metres: at its end a bedspread is stuck in the headboard.
const UNUSUAL_M: f64 = 0.05;
/// How far what hangs is pushed out, metres: beyond, the host is in its way, as an arm is.
const MAX_OUT_M: f64 = 0.3;
/// Air between cloth and what it touches, metres.
const AIR_M: f64 = 0.004;
/// How far below what lies there a point hangs, metres, and the middle of an edge, share of its length.
const HANGS_M: f64 = 0.02;
const MIDDLE: f64 = 0.3;
/// The part between what lies and what hangs, share of the way from the edge to what is farthest out; and that way at least,
/// metres.
const SHOULDER: f64 = 0.25;
const THINNEST_M: f64 = 0.03;
/// Edges of a cloth are cut to this length, metres, while it has no more triangles than that.
const LONGEST_EDGE_M: f32 = 0.04;
const MAX_TRIANGLES: usize = 200_000;
/// Moves of no point are worth a new shape below this, metres.
const HARDLY_M: f64 = 0.004;

/// A cloth as it lies on its host.
#[derive(Debug, Clone)]
pub struct Draped {
    /// Its shape, in the frame of the one before.
    pub shape: Arc<Shape>,
    /// What it lies on.
    pub host: ObjectId,
    /// How far the point went that went farthest, metres.
    pub farthest_m: f64,
}

/// A placed cloth as it lies on its host; `None` of what hangs over nothing, on nothing, or lies well already.
pub fn drape(scene: &PartialScene, object: &ObjectId) -> Option<Draped> {
    let cloth = scene.find(object)?;
    let Support::Object { id } = &cloth.support else { return None };
    let host = scene.find(id).filter(|host| host.item.id != *object)?;
    let form = Form::of(cloth)?;
    let lying = form.lying(cloth, host)?;
    let mut draped = (**cloth.item.shape.mesh()).clone();
    let scale = cloth.pose.scale * cloth.pose.stretch;
    draped.split_long_edges(scale.as_vec3(), LONGEST_EDGE_M, MAX_TRIANGLES);
    let mut points: Vec<Vec3> = draped.positions.iter().map(|p| form.local(cloth.pose.point(p.as_dvec3()))).collect();
    let sides = form.sides(&points);
    for p in &mut points {
        p.y += lying.at(form.over(*p));
    }
    for side in Side::ALL {
        let hangs: Vec<(usize, f64)> = form.leaf(side, &points, &sides);
        let whole = hangs.iter().filter(|(_, share)| *share >= 1.0);
        if let Some(push) = form.push(whole.map(|(i, _)| points[*i]), host, side) {
            for (i, share) in hangs {
                let p = &mut points[i];
                *p += side.outward() * (share * push.at(Vec2::new(side.along(*p), p.y)));
            }
        }
    }
    let back = cloth.pose.linear().inverse();
    let mut farthest: f64 = 0.0;
    for (p, local) in draped.positions.iter_mut().zip(&points) {
        let there = form.room(*local);
        farthest = farthest.max(there.distance(cloth.pose.point(p.as_dvec3())));
        *p = (back * (there - cloth.pose.position)).as_vec3();
    }
    if farthest < HARDLY_M || !draped.positions.iter().all(|p| p.is_finite()) {
        return None;
    }
    draped.recompute_normals();
    let shape = Shape::from_parts(Arc::new(draped), None, cloth.size().as_vec().max_element());
    Some(Draped { shape: Arc::new(shape), host: id.clone(), farthest_m: farthest })
}

/// The scene with a draped cloth in it.
pub fn drape_in(
    scene: &PartialScene,
    object: &ObjectId,
    shape: &Arc<Shape>,
    settings: &PlacementSettings,
) -> Option<PartialScene> {
    let i = scene.position(object)?;
    let mut after = scene.clone();
    Arc::make_mut(&mut after.placed[i].item).shape = Arc::clone(shape);
    after.placed[i].evidence = measure(&after, i, settings);
    Some(after)
}

/// A side on which cloth hangs down.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Side {
    Right,
    Left,
    Front,
    Back,
}

impl Side {
    const ALL: [Self; 4] = [Self::Right, Self::Left, Self::Front, Self::Back];

    fn outward(self) -> Vec3 {
        match self {
            Self::Right => Vec3::X,
            Self::Left => Vec3::NEG_X,
            Self::Front => Vec3::Z,
            Self::Back => Vec3::NEG_Z,
        }
    }

    /// The level coordinate along the edge over which it hangs.
    fn along(self, p: Vec3) -> f64 {
        if matches!(self, Self::Right | Self::Left) { p.z } else { p.x }
    }
}

/// How a cloth lies: its frame, and the rectangle of what lies on its host.
struct Form {
    origin: Vec3,
    axes: [Vec3; 2],
    /// x and z, least and greatest.
    lies: [Vec2; 2],
    /// Height of what lies there.
    sag: f64,
    low: Vec3,
    high: Vec3,
}

impl Form {
    fn of(cloth: &Placed) -> Option<Self> {
        let (item, pose) = (&cloth.item, &cloth.pose);
        let hang = hang_of(item)?;
        let metric = Pose { scale: 1.0, stretch: Vec3::ONE, ..*pose }.linear();
        let scale = pose.scale * pose.stretch;
        let size = size_of(item, pose);
        // Columns were looked at in their middles.
        let half = Vec2::new(size.x, size.z) / f64::from(2 * HANG_COLUMNS);
        let at = |p: &Vec2| Vec2::new(p.x * scale.x, p.y * scale.z);
        let least = hang.under.iter().map(at).fold(Vec2::INFINITY, Vec2::min) - half;
        let greatest = hang.under.iter().map(at).fold(Vec2::NEG_INFINITY, Vec2::max) + half;
        let bounds = item.shape.bounds();
        least.cmplt(greatest).all().then(|| Self {
            origin: pose.position,
            axes: [metric * Vec3::X, metric * Vec3::Z],
            lies: [least, greatest],
            sag: sag_of(item, pose),
            low: bounds.min * scale,
            high: bounds.max * scale,
        })
    }

    fn local(&self, p: Vec3) -> Vec3 {
        let p = p - self.origin;
        Vec3::new(self.axes[0].dot(p), p.y, self.axes[1].dot(p))
    }

    fn room(&self, p: Vec3) -> Vec3 {
        self.origin + self.axes[0] * p.x + Vec3::Y * p.y + self.axes[1] * p.z
    }

    /// The place on what lies there from which a point hangs, or on which it is: x and z.
    fn over(&self, p: Vec3) -> Vec2 {
        Vec2::new(p.x, p.z).clamp(self.lies[0], self.lies[1])
    }

    /// How far out on a side something lies.
    fn edge(&self, side: Side) -> f64 {
        let [least, greatest] = self.lies;
        match side {
            Side::Right => greatest.x,
            Side::Left => -least.x,
            Side::Front => greatest.y,
            Side::Back => -least.y,
        }
    }

    /// What hangs on a side, and by how much of its push each point goes: all of it but for the shoulder next to what lies there.
    fn leaf(&self, side: Side, points: &[Vec3], sides: &[Option<Side>]) -> Vec<(usize, f64)> {
        let out = |i: usize| side.outward().dot(points[i]);
        let hangs: Vec<usize> = (0..points.len()).filter(|i| sides[*i] == Some(side)).collect();
        let farthest = hangs.iter().map(|i| out(*i)).fold(f64::NEG_INFINITY, f64::max);
        let edge = self.edge(side).min(farthest - THINNEST_M);
        hangs.into_iter().map(|i| (i, ((out(i) - edge) / (SHOULDER * (farthest - edge))).clamp(0.0, 1.0))).collect()
    }

    /// On which side each point hangs, if it does.
    fn sides(&self, points: &[Vec3]) -> Vec<Option<Side>> {
        let hangs = |p: &Vec3| p.y < self.low.y + self.sag - HANGS_M;
        let beyond = |p: Vec3, side: Side| side.outward().dot(p) - self.edge(side);
        let nearest = |p: Vec3, of: &[Side]| of.iter().copied().max_by(|a, b| beyond(p, *a).total_cmp(&beyond(p, *b)));
        // Nothing hangs from the middle of an edge at which only the ends of others' hems are.
        let middle = |p: Vec3, side: Side| {
            let (low, high) = (side.along(self.low), side.along(self.high));
            (side.along(p) - f64::midpoint(low, high)).abs() <= MIDDLE * (high - low) / 2.0
        };
        let hung: Vec<Side> = Side::ALL
            .into_iter()
            .filter(|side| {
                points.iter().any(|p| hangs(p) && middle(*p, *side) && nearest(*p, &Side::ALL) == Some(*side))
            })
            .collect();
        points.iter().map(|p| if hangs(p) { nearest(*p, &hung) } else { None }).collect()
    }

    /// How far what lies there rises, over x and z.
    fn lying(&self, cloth: &Placed, host: &Placed) -> Option<Field> {
        let height = self.high.y - self.low.y;
        let rises = |at: Vec2| {
            let from = Vec3::new(at.x, self.low.y - 0.1 * height, at.y);
            let up = self.first_hit(cloth, from, Vec3::Y, 1.2 * height)?;
            // Beyond the edge the underside is that of what hangs.
            let underside = (up.y - self.low.y >= 0.5 * self.sag).then_some(up)?;
            let place = self.room(underside);
            let by = lying_height(host, place.x, place.z, place.y)? + AIR_M - place.y;
            (LIFTS_M[0]..=LIFTS_M[1]).contains(&by).then_some(by)
        };
        Field::measured(self.lies, rises)
    }

    fn first_hit(&self, cloth: &Placed, from: Vec3, direction: Vec3, max: f64) -> Option<Vec3> {
        let (origin, towards) = (self.room(from), self.room(from + direction) - self.room(from));
        let (hit, _) = crate::scene::support::ray_hit(cloth, origin, towards)?;
        Some(self.local(hit)).filter(|p| p.distance(from) <= max)
    }

    /// How far what hangs on a side goes out, over the way along its edge and the height; `None` where nothing hangs or nothing is
    /// in its way.
    fn push(&self, points: impl Iterator<Item = Vec3>, host: &Placed, side: Side) -> Option<Field> {
        let outward = self.room(side.outward()) - self.origin;
        let hangs: Vec<(Vec2, f64)> =
            points.map(|p| (Vec2::new(side.along(p), p.y), way_out(host, self.room(p), outward, MAX_OUT_M))).collect();
        if !hangs.iter().any(|(_, out)| *out > 0.0) {
            return None;
        }
        let low = hangs.iter().map(|(at, _)| *at).fold(Vec2::INFINITY, Vec2::min);
        let high = hangs.iter().map(|(at, _)| *at).fold(Vec2::NEG_INFINITY, Vec2::max);
        let mut field = Field::empty([low, high]);
        for (at, out) in hangs {
            let value = if out > 0.0 { out + AIR_M } else { 0.0 };
            let cell = field.cell(at);
            field.values[cell] = field.values[cell].max(value);
        }
        // It hangs straight down from where it is farthest out.
        for row in (0..field.cells[1].saturating_sub(1)).rev() {
            for column in 0..field.cells[0] {
                let above = field.values[(row + 1) * field.cells[0] + column];
                let here = &mut field.values[row * field.cells[0] + column];
                *here = here.max(above);
            }
        }
        Some(field.spread())
    }
}

/// Numbers over a rectangle.
struct Field {
    low: Vec2,
    step: Vec2,
    cells: [usize; 2],
    /// Row by row.
    values: Vec<f64>,
}

impl Field {
    fn empty([low, high]: [Vec2; 2]) -> Self {
        let size = (high - low).max(Vec2::splat(1e-6));
        let cells = [size.x, size.y].map(|side| ((side / CELL_M).ceil() as usize).clamp(1, MAX_CELLS));
        let step = Vec2::new(size.x / cells[0] as f64, size.y / cells[1] as f64);
        Self { low, step, cells, values: vec![0.0; cells[0] * cells[1]] }
    }

    /// What is measured in the middle of each cell; where nothing is, or what is far from usual, as the nearest ones have it.
    fn measured(over: [Vec2; 2], of: impl Fn(Vec2) -> Option<f64>) -> Option<Self> {
        let mut field = Self::empty(over);
        let mut known: Vec<Option<f64>> = (0..field.values.len()).map(|i| of(field.middle(i))).collect();
        let mut all: Vec<f64> = known.iter().flatten().copied().collect();
        if all.is_empty() {
            return None;
        }
        // One of them, so that at least one stays.
        let usual = crate::stats::median(&mut all);
        for one in &mut known {
            *one = one.filter(|v| (v - usual).abs() <= UNUSUAL_M);
        }
        while known.iter().any(Option::is_none) {
            let before = known.clone();
            for i in (0..known.len()).filter(|i| before[*i].is_none()) {
                let near: Vec<f64> = field.beside(i).filter_map(|k| before[k]).collect();
                known[i] = (!near.is_empty()).then(|| near.iter().sum::<f64>() / near.len() as f64);
            }
        }
        field.values = known.into_iter().flatten().collect();
        Some(field.spread())
    }

    fn middle(&self, i: usize) -> Vec2 {
        let at = Vec2::new((i % self.cells[0]) as f64 + 0.5, (i / self.cells[0]) as f64 + 0.5);
        self.low + at * self.step
    }

    fn cell(&self, at: Vec2) -> usize {
        let at = (at - self.low) / self.step;
        let [x, y] = [(at.x, 0), (at.y, 1)].map(|(v, k)| (v.max(0.0) as usize).min(self.cells[k] - 1));
        y * self.cells[0] + x
    }

    /// The cells around one, itself among them.
    fn beside(&self, i: usize) -> impl Iterator<Item = usize> + use<> {
        let [w, h] = self.cells;
        let (x, y) = (i % w, i / w);
        let rows = y.saturating_sub(1)..(y + 2).min(h);
        rows.flat_map(move |y| (x.saturating_sub(1)..(x + 2).min(w)).map(move |x| y * w + x))
    }

    /// Smooth, and nowhere less than it was in a cell.
    fn spread(mut self) -> Self {
        let greatest: Vec<f64> = (0..self.values.len())
            .map(|i| self.beside(i).map(|k| self.values[k]).fold(f64::NEG_INFINITY, f64::max))
            .collect();
        self.values = (0..greatest.len())
            .map(|i| {
                let near: Vec<f64> = self.beside(i).map(|k| greatest[k]).collect();
                near.iter().sum::<f64>() / near.len() as f64
            })
            .collect();
        self
    }

    /// Between the middles of cells in proportion.
    fn at(&self, at: Vec2) -> f64 {
        let at = (at - self.low) / self.step - 0.5;
        let [x, y] = [(at.x, 0), (at.y, 1)].map(|(v, k)| {
            let most = (self.cells[k] - 1) as f64;
            let v = v.clamp(0.0, most);
            let cell = v.floor().min((most - 1.0).max(0.0));
            (cell as usize, v - cell)
        });
        let value = |dx: usize, dy: usize| {
            let (cx, cy) = ((x.0 + dx).min(self.cells[0] - 1), (y.0 + dy).min(self.cells[1] - 1));
            self.values[cy * self.cells[0] + cx]
        };
        let row = |dy: usize| value(0, dy) * (1.0 - x.1) + value(1, dy) * x.1;
        row(0) * (1.0 - y.1) + row(1) * y.1
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{BACK_Z, add, armchair, empty_room, of_boxes, throw_over_an_edge};

    /// A throw over the back of a chair, in which its front leaf is stuck.
    fn scene(before_back: f64) -> PartialScene {
        let mut scene = empty_room();
        let chair = Arc::new(armchair());
        add(&mut scene, "armchair_01", chair.extent(), Vec3::new(1.2, 0.0, 1.5), |p| {
            p.pose.yaw = 0.4;
            Arc::make_mut(&mut p.item).shape = Arc::clone(&chair);
        });
        let [throw, _] = throw_over_an_edge();
        let at = scene.placed[0].pose.point(Vec3::new(0.0, 0.95 - 0.586, BACK_Z + before_back));
        add(&mut scene, "throw_01", throw.extent(), at, |p| {
            p.pose.yaw = 0.4;
            p.support = Support::Object { id: ObjectId::new("armchair_01").unwrap() };
            let item = Arc::make_mut(&mut p.item);
            (item.traits.soft, item.traits.drapes) = (true, true);
            item.shape = Arc::new(throw);
        });
        scene
    }

    /// Where the points of a throw's shape are in its chair's frame.
    fn points(scene: &PartialScene, shape: &Shape) -> Vec<Vec3> {
        let (chair, throw) = (&scene.placed[0].pose, &scene.placed[1].pose);
        let back = chair.linear().inverse();
        shape.mesh().positions.iter().map(|p| back * (throw.point(p.as_dvec3()) - chair.position)).collect()
    }

    #[test]
    fn a_throw_hangs_before_the_upholstery_and_lies_on_the_back() {
        let scene = scene(0.0);
        let throw = ObjectId::new("throw_01").unwrap();
        let (host, before) = (&scene.placed[0], points(&scene, &scene.placed[1].item.shape));
        let stuck = |points: &[Vec3]| {
            let out = |p: &Vec3| way_out(host, host.pose.point(*p), host.pose.front(), 1.0);
            points.iter().filter(|p| p.z > BACK_Z + 0.1 && p.y < 0.9).map(out).fold(0.0, f64::max)
        };
        assert!(stuck(&before) > 0.1, "{}", stuck(&before));
        let draped = drape(&scene, &throw).unwrap();
        let after = points(&scene, &draped.shape);
        assert!(stuck(&after) < 1e-6, "{}", stuck(&after));
        for (p, q) in before.iter().zip(&after) {
            // To its side nothing goes, behind the back nothing is in the way, and the hem is no farther out than the upholstery.
            assert!((p.x - q.x).abs() < 1e-6, "{p} {q}");
            assert!(p.z > BACK_Z - 0.1 || (p.z - q.z).abs() < 0.01, "{p} {q}");
            assert!(q.z < BACK_Z + 0.23 + 0.014 + 0.02, "{q}");
        }
        // It lay 3 cm deep in the back.
        let top = |points: &[Vec3]| points.iter().map(|p| p.y).fold(0.0, f64::max);
        assert!((top(&after) - 0.994).abs() < 0.015 && (top(&before) - 0.964).abs() < 1e-4, "{}", top(&after));
        // Its leaves are as thick as before.
        let thick = |points: &[Vec3], strip: usize| points[8 * strip + 4].z - points[8 * strip].z;
        assert!((0..14).all(|k| (thick(&before, k) - thick(&after, k)).abs() < 0.004));
        let draped = drape_in(&scene, &throw, &draped.shape, &PlacementSettings::default()).unwrap();
        assert!(drape(&draped, &throw).is_none_or(|again| {
            let again = points(&draped, &again.shape);
            again.iter().zip(&after).all(|(p, q)| p.distance(*q) < 0.03)
        }));
    }

    #[test]
    fn what_stands_or_lies_on_nothing_stays() {
        let mut scene = scene(0.0);
        let throw = ObjectId::new("throw_01").unwrap();
        assert!(drape(&scene, &ObjectId::new("armchair_01").unwrap()).is_none());
        scene.placed[1].support = Support::Floor;
        assert!(drape(&scene, &throw).is_none());
        // Across the room from its host.
        scene.placed[1].support = Support::Object { id: ObjectId::new("armchair_01").unwrap() };
        scene.placed[1].pose.position += Vec3::X;
        assert!(drape(&scene, &throw).is_none());
    }

    /// A bed whose frame stands out 6 cm at three sides, and a spread over it that ends 3 cm within the headboard.
    #[test]
    fn a_bedspread_hangs_around_the_frame_and_does_not_climb_the_headboard() {
        let mut scene = empty_room();
        let bed = Arc::new(of_boxes(&[
            (Vec3::new(1.4, 0.5, 1.9), Vec3::ZERO),
            (Vec3::new(1.52, 0.3, 1.96), Vec3::Z * 0.03),
            (Vec3::new(1.52, 0.57, 0.08), Vec3::Z * -0.99),
        ]));
        add(&mut scene, "bed_01", bed.extent(), Vec3::new(2.0, 0.0, 2.0), |p| {
            Arc::make_mut(&mut p.item).shape = Arc::clone(&bed);
        });
        let (sheet, side) = (Vec3::new(1.44, 0.02, 1.95), Vec3::new(0.02, 0.4, 1.95));
        let spread = of_boxes(&[
            (sheet, Vec3::Y * 0.38),
            (side, Vec3::X * 0.71),
            (side, Vec3::X * -0.71),
            (Vec3::new(1.44, 0.4, 0.02), Vec3::Z * 0.965),
        ]);
        let at = Vec3::new(2.0, 0.12, 2.0);
        add(&mut scene, "bedspread_01", spread.extent(), at, |p| {
            p.support = Support::Object { id: ObjectId::new("bed_01").unwrap() };
            let item = Arc::make_mut(&mut p.item);
            (item.traits.soft, item.traits.drapes) = (true, true);
            item.shape = Arc::new(spread);
        });
        let draped = drape(&scene, &ObjectId::new("bedspread_01").unwrap()).unwrap();
        for p in draped.shape.mesh().positions.iter().map(|p| p.as_dvec3()) {
            assert!(p.y < 0.43, "it climbs: {p}");
            let side = p.y < 0.15 && p.z < 0.9;
            assert!(!side || p.x.abs() >= 0.76, "in the frame: {p}");
            let foot = p.y < 0.15 && p.x.abs() < 0.6 && p.z > 0.5;
            assert!(!foot || p.z >= 1.01, "in the frame: {p}");
            assert!(p.x.abs() < 0.82 && p.z < 1.08, "far out: {p}");
        }
    }

    #[test]
    fn a_field_is_smooth_and_nowhere_less() {
        let over = [Vec2::ZERO, Vec2::new(0.5, 0.25)];
        let bump = |at: Vec2| (at.x < 0.3).then_some(if at.x < 0.1 { 0.05 } else { 0.0 });
        let field = Field::measured(over, bump).unwrap();
        for i in 0..field.values.len() {
            let at = field.middle(i);
            assert!(field.at(at) >= bump(at).unwrap_or(0.0) - 1e-12);
        }
        // Far from the bump, and where nothing is known, it is as beside.
        assert!(field.at(Vec2::new(0.45, 0.1)).abs() < 1e-12);
        let steps = (0..50).map(|k| field.at(Vec2::new(0.01 * f64::from(k), 0.1))).collect::<Vec<_>>();
        assert!(steps.windows(2).all(|s| (s[1] - s[0]).abs() < 0.01), "{steps:?}");
        assert!(Field::measured(over, |_| None).is_none());
    }
}
