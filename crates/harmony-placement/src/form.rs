//! The inner form of a shape by what is seen of it (key `shape.depth`): where a point map is good, seats, arms, backs and tops go where
//! silhouette and depth have them, not pose and size alone.
//!
//! A shape is bent along its three axes ([`Bend`]): wherever it has much level or upright surface (a seat, the inner side
//! of an arm, the front of a back) there is a knot, which moves along the axis while the ends stay; between knots it is
//! stretched evenly. What is straight along the axes stays straight. A knot costs what its sigma says ([`Noise::form`]), so
//! that what is not seen stays as it was modelled. Canonical frame.

use std::sync::Arc;

use harmony_scene::{Level, ObjectId, Pose, Support, Vec3};

use crate::noise::Noise;
use crate::observe::Window;
use crate::scene::subtree::take_along;
use crate::terms::told_objective;
use crate::{PartialScene, PlacementSettings, RoomPoints, Shape, measure};

/// Bins along an axis in which surface across it is looked for.
const BINS: usize = 32;
/// Surface across an axis, of the box's cross section, from which it is a step of the form.
const STEP_SHARE: f64 = 0.12;
/// Cosine from which a face lies across an axis.
const ACROSS: f32 = 0.9;
/// Steps nearer to an end than this are the end's, and nearer to one another than this are one; shares of the axis.
const APART: f64 = 0.08;
/// Knots of an axis at most, those with most surface.
const MAX_KNOTS: usize = 3;
/// Steps in which knots are moved, shares of the axis.
const MOVES: [f64; 3] = [0.06, 0.025, 0.01];
/// No stretch is left thinner than this share of what it was.
const THINNEST: f64 = 0.35;
/// Nats that a form must gain in all: fewer are the map's.
const MIN_GAIN: f64 = 3.0;
/// Share of the picture below which an object is too small to have a form.
const SMALLEST: f64 = 0.004;

/// Along each axis the knots of a shape: where they were and where they are, canonical units, increasing.
#[derive(Debug, Clone, PartialEq)]
pub struct Bend {
    /// x, y, z; the first and the last knot of each are its ends, and stay.
    pub axes: [Vec<[f64; 2]>; 3],
}

impl Bend {
    /// The knots of a shape, none of them moved.
    fn of(shape: &Shape) -> Self {
        let (min, max) = (shape.bounds().min, shape.bounds().max);
        Self {
            axes: std::array::from_fn(|axis| {
                let (low, high) = (min[axis], max[axis]);
                let mut knots = vec![low];
                knots.extend(steps(shape, axis).into_iter().map(|share| low + share * (high - low)));
                knots.push(high);
                knots.into_iter().map(|at| [at, at]).collect()
            }),
        }
    }

    /// Where a point goes.
    pub fn at(&self, p: Vec3) -> Vec3 {
        Vec3::from_array(std::array::from_fn(|axis| along(&self.axes[axis], p[axis]).0))
    }

    /// By what a shape is stretched at a point, along each axis.
    pub fn stretch(&self, p: Vec3) -> Vec3 {
        Vec3::from_array(std::array::from_fn(|axis| along(&self.axes[axis], p[axis]).1))
    }

    /// Loss of its knots' moves, nats.
    fn loss(&self, noise: &Noise) -> f64 {
        let of_axis = |knots: &Vec<[f64; 2]>| {
            let extent = (knots[knots.len() - 1][0] - knots[0][0]).max(1e-9);
            knots.iter().map(|[from, to]| 0.5 * ((to - from) / (noise.form * extent)).powi(2)).sum::<f64>()
        };
        self.axes.iter().map(of_axis).sum()
    }

    /// Whether every stretch is left thick enough.
    fn is_sound(&self) -> bool {
        self.axes.iter().all(|knots| knots.windows(2).all(|k| k[1][1] - k[0][1] >= THINNEST * (k[1][0] - k[0][0])))
    }
}

/// Where a coordinate goes, and the stretch there.
fn along(knots: &[[f64; 2]], at: f64) -> (f64, f64) {
    let i = knots[1..knots.len() - 1].iter().take_while(|[from, _]| at > *from).count();
    let ([a, to_a], [b, to_b]) = (knots[i], knots[i + 1]);
    let slope = if b - a > 1e-9 { (to_b - to_a) / (b - a) } else { 1.0 };
    (to_a + (at - a) * slope, slope)
}

/// Where along an axis a shape has much surface across it, between its ends, shares of its size.
fn steps(shape: &Shape, axis: usize) -> Vec<f64> {
    let (low, size) = (shape.bounds().min[axis], shape.extent());
    let section = size[(axis + 1) % 3] * size[(axis + 2) % 3];
    let mut bins = [0.0; BINS];
    let proxy = shape.proxy();
    for t in &proxy.triangles {
        let [a, b, c] = t.map(|i| proxy.points[i as usize]);
        let across = (b - a).cross(c - a);
        let area = across.length();
        if area > 0.0 && across[axis].abs() >= ACROSS * area {
            let middle = f64::from((a[axis] + b[axis] + c[axis]) / 3.0);
            let bin = ((middle - low) / size[axis] * BINS as f64) as usize;
            bins[bin.min(BINS - 1)] += 0.5 * f64::from(area);
        }
    }
    // A step that falls into two bins is one.
    let around = |k: usize| bins[k.saturating_sub(1)..(k + 2).min(BINS)].iter().sum::<f64>();
    let mut by_area: Vec<(f64, usize)> = (0..BINS).map(|k| (around(k), k)).collect();
    by_area.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let mut found: Vec<f64> = Vec::new();
    for (area, bin) in by_area {
        let share = (bin as f64 + 0.5) / BINS as f64;
        let is_free =
            found.iter().all(|other| (other - share).abs() >= APART) && (APART..=1.0 - APART).contains(&share);
        if area >= STEP_SHARE * section && is_free && bins[bin] > 0.0 && found.len() < MAX_KNOTS {
            found.push(share);
        }
    }
    found.sort_by(f64::total_cmp);
    found
}

/// What bending an object's shape brought.
#[derive(Debug, Clone)]
pub struct FittedForm {
    /// How it is bent.
    pub bend: Bend,
    /// The shape, bent.
    pub shape: Arc<Shape>,
    /// What that explains more, nats.
    pub gained: f64,
}

/// Bends a placed object's shape so that it agrees with mask and point map; `None` where there is no dense map, too little of it
/// is seen, it has no form (pictures, rugs, what hangs on walls), or nothing is gained.
pub fn fit_form(scene: &PartialScene, object: &ObjectId, settings: &PlacementSettings) -> Option<FittedForm> {
    let i = scene.position(object)?;
    let placed = &scene.placed[i];
    let item = &placed.item;
    let is_solid = !(item.traits.planar || item.traits.flat || item.traits.opening) && item.level != Level::Wall;
    let is_large = item.mask.count() as f64 >= SMALLEST * scene.camera.size.pixels() as f64;
    if !(settings.point_map && is_solid && is_large && scene.points.as_ref().is_some_and(RoomPoints::is_dense)) {
        return None;
    }
    let window = Window::new(scene, item, Some(i), &[], settings)?;
    let objective = told_objective(scene, i, &window, settings);
    let energy = |shape: &Shape, bend: &Bend| {
        objective.form(shape, &placed.pose).map(|of_form| of_form + bend.loss(&settings.noise))
    };
    let mut best = Bend::of(&item.shape);
    let before = energy(&item.shape, &best)?;
    let mut least = before;
    for step in MOVES {
        // Twice: knots share the stretches between them.
        for _ in 0..2 {
            for axis in 0..3 {
                let knots = best.axes[axis].len();
                let extent = item.shape.extent()[axis];
                for knot in 1..knots - 1 {
                    for by in [-step, step] {
                        let mut tried = best.clone();
                        tried.axes[axis][knot][1] += by * extent;
                        if !tried.is_sound() {
                            continue;
                        }
                        let of = energy(&item.shape.drawn_bent(&tried), &tried)?;
                        if of < least {
                            (least, best) = (of, tried);
                        }
                    }
                }
            }
        }
    }
    let gained = before - least;
    (gained >= MIN_GAIN).then(|| FittedForm { shape: Arc::new(item.shape.bent(&best)), bend: best, gained })
}

/// The scene with an object's shape bent, and what stands on it, with what stands on that, where its surface has gone.
pub fn bend_in(
    scene: &PartialScene,
    object: &ObjectId,
    fitted: &FittedForm,
    settings: &PlacementSettings,
) -> Option<PartialScene> {
    let i = scene.position(object)?;
    let mut after = scene.clone();
    Arc::make_mut(&mut after.placed[i].item).shape = Arc::clone(&fitted.shape);
    let pose = scene.placed[i].pose;
    let stands = |k: &usize| matches!(&scene.placed[*k].support, Support::Object { id } if id == object);
    for k in (0..scene.placed.len()).filter(stands) {
        let old = scene.placed[k].pose;
        let local = pose.linear().inverse() * (old.position - pose.position);
        let risen = (pose.linear() * (fitted.bend.at(local) - local)).y;
        take_along(&mut after, k, Pose { position: old.position + Vec3::Y * risen, ..old });
    }
    after.placed[i].evidence = measure(&after, i, settings);
    Some(after)
}

#[cfg(test)]
mod tests {
    use harmony_scene::{ImageSize, PointMapKind};

    use super::*;
    use crate::testing::{boxed, empty_room, of_boxes, seen};

    /// A sofa with a seat at 45 cm and a back of 20 cm, modelled with the seat at 60 and the back of 35, in a room of which every
    /// pixel's depth is known.
    #[test]
    fn seat_and_back_go_where_depth_has_them() {
        let sofa = |seat: f64, back: f64| {
            of_boxes(&[
                (Vec3::new(2.0, seat, 0.9), Vec3::new(0.0, 0.0, 0.0)),
                (Vec3::new(2.0, 1.0 - seat, back), Vec3::new(0.0, seat, -0.45 + back / 2.0)),
            ])
        };
        let mut scene = empty_room();
        let at = Vec3::new(2.0, 0.0, 2.0);
        let truth = sofa(0.45, 0.2);
        let pose = Pose::new(at, 0.3, 1.0);
        let size: ImageSize = scene.camera.size;
        let mut depth = vec![0.0; size.pixels()];
        crate::observe::raster::rasterise(&scene.camera, truth.proxy(), &pose, &mut depth);
        let place = |(k, z): (usize, &f32)| {
            let pixel = glam::DVec2::new((k as u32 % size.width) as f64 + 0.5, (k as u32 / size.width) as f64 + 0.5);
            let ray = scene.camera.ray(pixel);
            let along = scene.camera.depth(ray.origin + ray.direction);
            if *z > 0.0 { ray.origin + ray.direction * (f64::from(*z) / along) } else { Vec3::splat(f64::NAN) }
        };
        let xyz: Vec<Vec3> = depth.iter().enumerate().map(place).collect();
        let confidence = xyz.iter().map(|p| f32::from(u8::from(p.is_finite()))).collect();
        let mut item = boxed(&scene, Vec3::new(2.0, 1.0, 0.9), at, 0.3);
        item.mask = seen(&scene, &truth, &pose).into();
        item.shape = Arc::new(sofa(0.6, 0.35));
        let id = item.id.clone();
        scene.points = Some(RoomPoints { kind: PointMapKind::Metric, size, xyz, confidence });
        scene.placed.push(crate::Placed {
            item: Arc::new(item),
            pose,
            support: Support::Floor,
            evidence: crate::Evidence::default(),
        });
        let settings = PlacementSettings::default();
        let fitted = fit_form(&scene, &id, &settings).expect("its form is seen");
        let seat = fitted.bend.at(Vec3::new(0.0, 0.6, 0.0)).y;
        let back = fitted.bend.at(Vec3::new(0.0, 0.8, -0.1)).z;
        assert!((seat - 0.45).abs() < 0.03, "{seat}");
        assert!((back + 0.25).abs() < 0.035, "{back}");
        // What stands on the seat goes down with it.
        let on_it = at + harmony_scene::Mat3::from_rotation_y(0.3) * Vec3::new(0.3, 0.6, 0.2);
        let mut with = scene.clone();
        crate::testing::add(&mut with, "cushion_01", Vec3::splat(0.2), on_it, |placed| {
            placed.support = Support::Object { id: id.clone() };
        });
        let with = bend_in(&with, &id, &fitted, &settings).unwrap();
        assert!((with.placed[1].pose.position.y - seat).abs() < 1e-6, "{:?}", with.placed[1].pose);
        // The ends stay, the mesh goes with the form, and a second time there is nothing to gain.
        assert!((fitted.shape.extent() - Vec3::new(2.0, 1.0, 0.9)).abs().max_element() < 1e-6);
        let mut again = scene.clone();
        Arc::make_mut(&mut again.placed[0].item).shape = fitted.shape;
        assert!(fit_form(&again, &id, &settings).is_none());
        // What is right stays, and so does what no map shows.
        Arc::make_mut(&mut again.placed[0].item).shape = Arc::new(truth);
        assert!(fit_form(&again, &id, &settings).is_none());
        scene.points = None;
        assert!(fit_form(&scene, &id, &settings).is_none());
    }

    #[test]
    fn a_bend_keeps_its_ends_and_tells_its_stretch() {
        let knots = vec![[0.0, 0.0], [0.5, 0.3], [1.0, 1.0]];
        let bend = Bend { axes: [vec![[-1.0, -1.0], [1.0, 1.0]], knots, vec![[-1.0, -1.0], [1.0, 1.0]]] };
        assert!(bend.at(Vec3::new(0.2, 0.25, -0.7)).distance(Vec3::new(0.2, 0.15, -0.7)) < 1e-12);
        assert!((bend.at(Vec3::new(0.0, 0.75, 0.0)).y - 0.65).abs() < 1e-12);
        assert!((bend.stretch(Vec3::new(0.0, 0.75, 0.0)).y - 1.4).abs() < 1e-12);
        assert!(bend.is_sound());
    }
}
