//! The furniture maker: each function makes one object of random shape, in its canonical frame.
//!
//! The shapes are lofts, surfaces of revolution, bent sheets and superellipsoids, so that the part templates that the
//! pipeline may fit never match them exactly. Every object stays below 2,500 triangles.

mod bath;
mod beds;
mod decor;
mod lights;
mod plants;
mod seating;
mod storage;
mod tables;
mod wall;

use glam::{DVec3, Vec2, Vec3};
use harmony_mesh::{Group, Mesh};

pub(super) use bath::{bathtub, fridge, toilet, washbasin};
pub(super) use beds::{bed, teddy};
pub(super) use decor::*;
pub(super) use lights::*;
pub(super) use plants::{plant, small_plant};
pub(super) use seating::{armchair, bench, chair, office_chair, pouf, sofa, stool};
pub(super) use storage::{bookcase, cabinet, nightstand, wardrobe};
pub(super) use tables::{TableStyle, coffee_table, desk, dining_table, side_table};
pub(super) use wall::*;

use super::paint::Look;
use super::solid::Patch;

/// Most triangles of an object.
#[cfg(test)]
const MAX_TRIANGLES: usize = 2500;

/// A flat place that other things can stand on, in the canonical frame.
#[derive(Debug, Clone, Copy)]
pub(super) struct Top {
    /// Height.
    pub(super) y: f64,
    /// Smallest x and z.
    pub(super) min: [f64; 2],
    /// Largest x and z.
    pub(super) max: [f64; 2],
    /// Free height above, metres.
    pub(super) clear: f64,
}

/// A finished object.
#[derive(Debug, Clone)]
pub(super) struct Piece {
    /// What it is.
    pub(super) label: &'static str,
    /// Canonical mesh.
    pub(super) mesh: Mesh,
    /// Width, height, depth.
    pub(super) size: DVec3,
    /// Places for other things, the best first.
    pub(super) tops: Vec<Top>,
    /// Whether it gives light.
    pub(super) lit: bool,
}

/// Where the canonical origin lies.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Origin {
    /// Bottom centre.
    Bottom,
    /// Centre of the box.
    Centre,
}

/// Collects patches into a mesh.
#[derive(Debug, Default)]
pub(super) struct Sculptor {
    looks: Vec<Look>,
    parts: Vec<(usize, Patch)>,
    tops: Vec<Top>,
    lit: bool,
}

impl Sculptor {
    pub(super) fn new() -> Self {
        Self::default()
    }

    /// A look to use for parts.
    pub(super) fn look(&mut self, look: Look) -> usize {
        self.looks.push(look);
        self.looks.len() - 1
    }

    /// Adds a part.
    pub(super) fn add(&mut self, look: usize, patch: Patch) {
        self.parts.push((look, patch));
    }

    /// Marks a flat place of `w` by `d` around (x, z).
    pub(super) fn top(&mut self, y: f32, centre: [f32; 2], w: f32, d: f32, clear: f32) {
        let at = |i: usize, half: f32, sign: f32| f64::from(centre[i] + sign * half / 2.0);
        self.tops.push(Top {
            y: y.into(),
            min: [at(0, w, -1.0), at(1, d, -1.0)],
            max: [at(0, w, 1.0), at(1, d, 1.0)],
            clear: clear.into(),
        });
    }

    /// The object gives light.
    pub(super) fn lights(&mut self) {
        self.lit = true;
    }

    /// The finished object.
    pub(super) fn finish(self, label: &'static str, origin: Origin) -> Piece {
        let (lo, hi) = self
            .parts
            .iter()
            .map(|(_, p)| p.bounds())
            .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(lo, hi), (a, b)| (lo.min(a), hi.max(b)));
        let centre = (lo + hi) / 2.0;
        let shift = if origin == Origin::Bottom { Vec3::new(centre.x, lo.y, centre.z) } else { centre };
        let mut mesh = Mesh::default();
        for (i, look) in self.looks.iter().enumerate() {
            mesh.materials.push(look.material.clone());
            let first = mesh.positions.len();
            for (_, patch) in self.parts.iter().filter(|(l, _)| *l == i) {
                facet(&mut mesh, patch, look.tile, shift);
            }
            let triangles = (first as u32..mesh.positions.len() as u32).step_by(3).map(|k| [k, k + 1, k + 2]);
            mesh.groups.push(Group { material: i, triangles: triangles.collect() });
        }
        let s = shift.as_dvec3();
        let tops = self.tops.into_iter().map(|t| Top {
            y: t.y - s.y,
            min: [t.min[0] - s.x, t.min[1] - s.z],
            max: [t.max[0] - s.x, t.max[1] - s.z],
            clear: t.clear,
        });
        let size = mesh.bounds().map_or(DVec3::ZERO, |b| b.size());
        Piece { label, size, tops: tops.collect(), lit: self.lit, mesh }
    }
}

/// Cosine of the angle up to which neighbouring faces are shaded as one.
const CREASE: f32 = 0.78;

/// Adds a patch with a vertex a corner: normals smooth over flat edges, texture projected along the face's main axis.
fn facet(mesh: &mut Mesh, patch: &Patch, tile: f32, shift: Vec3) {
    let corner = |i: u32| patch.points[i as usize];
    let area = |t: &[u32; 3]| (corner(t[1]) - corner(t[0])).cross(corner(t[2]) - corner(t[0]));
    let faces: Vec<Vec3> = patch.triangles.iter().map(area).collect();
    let mut around: Vec<Vec<u32>> = vec![Vec::new(); patch.points.len()];
    for (k, t) in patch.triangles.iter().enumerate() {
        for i in t {
            around[*i as usize].push(k as u32);
        }
    }
    let (lo, hi) = patch.bounds();
    let size = (hi - lo).max(Vec3::splat(1e-4));
    for (t, face) in patch.triangles.iter().zip(&faces) {
        let Some(flat) = face.try_normalize() else { continue };
        for i in t {
            let near = around[*i as usize].iter().map(|k| faces[*k as usize]);
            let smooth: Vec3 = near.filter(|n| n.normalize_or_zero().dot(flat) > CREASE).sum();
            let p = corner(*i);
            mesh.positions.push(p - shift);
            mesh.normals.push(smooth.normalize_or(flat));
            mesh.uvs.push(texture_point(p, lo, size, flat, tile));
        }
    }
}

fn texture_point(p: Vec3, lo: Vec3, size: Vec3, flat: Vec3, tile: f32) -> Vec2 {
    let a = flat.abs();
    if tile <= 0.0 {
        let q = (p - lo) / size;
        return if a.y > a.x.max(a.z) { Vec2::new(q.x, q.z) } else { Vec2::new(q.x, 1.0 - q.y) };
    }
    let k = 1.0 / tile;
    if a.y >= a.x && a.y >= a.z {
        Vec2::new(p.x, p.z) * k
    } else if a.x >= a.z {
        Vec2::new(p.y, p.z) * k
    } else {
        Vec2::new(p.x, p.y) * k
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::generate::dice::Dice;
    use crate::generate::paint::Palette;

    type Maker = fn(&mut Dice, &Palette) -> Piece;

    const MAKERS: [Maker; 46] = [
        bathtub_of_usual_size,
        |d, p| fridge(d, p),
        |d, p| toilet(d, p),
        |d, p| washbasin(d, p),
        |d, p| bed(d, p, 1.6, 2.1),
        |d, p| teddy(d, p),
        |d, p| vase(d, p),
        |d, p| bowl(d, p),
        |d, p| mug(d, p),
        |d, p| plate(d, p),
        |d, p| books(d, p),
        |d, p| photo_frame(d, p),
        |d, p| candle(d, p),
        |d, _| monitor(d, "tv", 1.2),
        |d, _| laptop(d),
        |d, p| pen_holder(d, p),
        |d, p| cushion(d, p),
        |d, p| basket(d, p),
        |d, p| waste_bin(d, p),
        |d, p| ball(d, p),
        |d, p| rug(d, p, 2.0, 1.5),
        |d, p| kettle(d, p),
        |d, p| table_lamp(d, p),
        |d, p| desk_lamp(d, p),
        |d, p| floor_lamp(d, p),
        |d, p| pendant(d, p, 0.8),
        |d, p| ceiling_lamp(d, p),
        |d, p| chandelier(d, p, 0.7),
        |d, p| ceiling_fan(d, p),
        |d, p| plant(d, p),
        |d, p| small_plant(d, p),
        |d, p| armchair(d, p),
        |d, p| bench(d, p, 1.2),
        |d, p| chair(d, p),
        |d, p| office_chair(d, p),
        |d, p| sofa(d, p, 2.4, Some(1.0)),
        |d, p| cabinet(d, p, "sideboard", [1.9, 0.95, 0.45]),
        |d, p| bookcase(d, p, [1.0, 2.1, 0.3]),
        |d, p| wardrobe(d, p, 2.2),
        |d, p| dining_table(d, p, [1.6, 0.9], TableStyle::Legs),
        |d, p| dining_table(d, p, [1.2, 1.2], TableStyle::Pedestal),
        |d, p| coffee_table(d, p),
        |d, p| side_table(d, p),
        |d, p| desk(d, p, 1.5),
        |d, p| curtains(d, p, 1.6, 2.1),
        |d, p| door(d, p, 0.9, 2.05),
    ];

    fn bathtub_of_usual_size(d: &mut Dice, p: &Palette) -> Piece {
        bathtub(d, p, 1.6)
    }

    #[test]
    fn pieces_have_few_triangles_a_positive_volume_and_tops_at_their_height() {
        let mut most = std::collections::BTreeMap::new();
        for seed in 0..25 {
            let mut dice = Dice::new(seed, 1);
            let palette = Palette::new(&mut dice);
            for make in MAKERS {
                let piece = make(&mut dice, &palette);
                piece.mesh.check().unwrap();
                let count = most.entry(piece.label).or_insert(0);
                *count = piece.mesh.triangle_count().max(*count);
                let volume: f32 = piece
                    .mesh
                    .triangles()
                    .map(|t| {
                        let [a, b, c] = t.map(|i| piece.mesh.positions[i as usize]);
                        a.dot(b.cross(c))
                    })
                    .sum();
                assert!(volume > 0.0, "{}", piece.label);
                let tree = harmony_mesh::Bvh::new(&piece.mesh);
                for top in &piece.tops {
                    let middle = |i: usize| f64::midpoint(top.min[i], top.max[i]);
                    let above = DVec3::new(middle(0), top.y + 0.04, middle(1));
                    let hit = tree.raycast(above, DVec3::NEG_Y, 1.0).unwrap();
                    assert!((hit.point.y - top.y).abs() < 2e-4, "{}: {} {}", piece.label, hit.point.y, top.y);
                }
            }
        }
        let over: Vec<_> = most.iter().filter(|(_, n)| **n > MAX_TRIANGLES).collect();
        assert!(over.is_empty(), "{over:?}");
    }
}
