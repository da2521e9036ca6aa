//! What stands in the room and nobody named: where nobody looked at the photo and a point map has something before the
//! room's faces, it is there as a relief, a sheet through its points with the photo on it, not as paint on the wall
//! behind it.
//!
//! A piece is what hangs together in the picture without a step in depth. It has no back and no name; it is seen right
//! from the photo's side, and moves as one thing.

use std::sync::Arc;

use glam::{DVec2, DVec3, Vec2};
use harmony_mesh::{Group, Material, Mesh};
use harmony_placement::{Evidence, Item, Placed, RoomPoints, Shape, Traits, YawHint};
use harmony_prompts::InspectedSize;
use harmony_roles::Detection;
use harmony_scene::{
    Camera, Extents, ImageSize, Level, Mask, ObjectId, PixelBox, Placement, Pose, Relations, Room, Size, Support, Wall,
};
use image::{DynamicImage, RgbImage};

use crate::ctx::{PhaseCtx, PhaseError};
use crate::state::{Model, Object, SceneState};
use crate::steps::surfaces;

/// What a relief is called.
const LABEL: &str = "relief";
/// Neighbouring points whose depths differ by more than this, metres or as a share, are on two things.
const STEP: f64 = 0.06;
const STEP_SHARE: f64 = 0.04;
/// Smaller pieces, as a share of the picture, stay paint: edges and noise of the map.
const SMALLEST: f64 = 0.002;
/// Most pieces of a room.
const MOST: usize = 40;
/// How often depths are averaged with their neighbours: what a sensor sees at four metres is rough by centimetres.
const SMOOTHED: usize = 2;
/// A piece whose lowest point is no higher than this stands on the floor, metres: points nearer to the floor are
/// the floor's.
const STANDS: f64 = 0.3;

/// Puts the reliefs into a scene that nobody looked at.
///
/// # Errors
/// Only that of a computation that broke.
pub async fn stand(ctx: &PhaseCtx<'_>, state: &mut SceneState) -> Result<(), PhaseError> {
    if ctx.is_seen() || !state.partial.points.as_ref().is_some_and(RoomPoints::is_dense) {
        return Ok(());
    }
    let (seen, faces) = (state.clone(), ctx.settings.mesh.faces as usize);
    let reliefs = ctx.computed(move || reliefs(&seen, faces)).await?;
    if !reliefs.is_empty() {
        ctx.step(&format!("{} reliefs of what nobody named", reliefs.len()));
    }
    for (k, relief) in reliefs.into_iter().enumerate() {
        add(state, ObjectId::numbered(LABEL, k + 1), relief);
    }
    Ok(())
}

/// A piece of the point map.
struct Relief {
    /// Its pixels.
    mask: Mask,
    /// The sheet: bottom at y = 0, its box centred in x and z, metres.
    mesh: Mesh,
    /// Where the middle of its box's bottom is.
    at: DVec3,
}

/// The pieces before the room's faces, the largest first.
fn reliefs(state: &SceneState, max_faces: usize) -> Vec<Relief> {
    let Some(points) = &state.partial.points else { return Vec::new() };
    let unnamed = surfaces::unnamed(state);
    let sheet = Sheet::new(points, &state.partial.camera, &unnamed);
    let mut pieces = sheet.pieces();
    let fewest = (SMALLEST * points.size.pixels() as f64) as usize;
    pieces.retain(|piece| piece.len() >= fewest);
    pieces.sort_by_key(|piece| std::cmp::Reverse(piece.len()));
    pieces.truncate(MOST);
    pieces.iter().filter_map(|piece| sheet.relief(piece, &state.photo, max_faces)).collect()
}

/// The grid of the points that lie before the room's faces.
struct Sheet<'a> {
    camera: &'a Camera,
    size: ImageSize,
    /// Depth along the photo's axis; `None` where the room's own face is seen, or nothing.
    depth: Vec<Option<f64>>,
}

impl<'a> Sheet<'a> {
    fn new(points: &RoomPoints, camera: &'a Camera, unnamed: &Mask) -> Self {
        let size = points.size;
        let mut sheet = Self { camera, size, depth: Vec::new() };
        sheet.depth = (0..size.pixels())
            .map(|i| {
                let at = sheet.place(i);
                let point = points.xyz.get(i).filter(|p| p.is_finite())?;
                let known = points.confidence.get(i).is_some_and(|c| *c > 0.0);
                let depth = camera.depth(*point);
                (known && depth > 0.0 && unnamed.get(at.x as i64, at.y as i64)).then_some(depth)
            })
            .collect();
        sheet
    }

    /// Where a point of the grid is in the photo, pixels.
    fn place(&self, i: usize) -> DVec2 {
        let (x, y) = (i % self.size.width as usize, i / self.size.width as usize);
        let (grid, photo) = (self.size, self.camera.size);
        DVec2::new(
            (x as f64 + 0.5) * f64::from(photo.width) / f64::from(grid.width),
            (y as f64 + 0.5) * f64::from(photo.height) / f64::from(grid.height),
        )
    }

    /// Whether two points are of one thing.
    fn holds(&self, a: usize, b: usize) -> bool {
        is_near(self.depth[a], self.depth[b])
    }

    /// Neighbours of a point left, right, above and below.
    fn neighbours(&self, i: usize) -> impl Iterator<Item = usize> {
        let (w, h) = (self.size.width as usize, self.size.height as usize);
        let (x, y) = (i % w, i / w);
        let all = [(x > 0, i.wrapping_sub(1)), (x + 1 < w, i + 1), (y > 0, i.wrapping_sub(w)), (y + 1 < h, i + w)];
        all.into_iter().filter_map(|(there, j)| there.then_some(j))
    }

    /// The points that hang together, in reading order of their first.
    fn pieces(&self) -> Vec<Vec<usize>> {
        let mut seen = vec![false; self.depth.len()];
        let mut pieces = Vec::new();
        for start in 0..self.depth.len() {
            if seen[start] || self.depth[start].is_none() {
                continue;
            }
            seen[start] = true;
            let (mut piece, mut next) = (vec![start], 0);
            while let Some(&i) = piece.get(next) {
                next += 1;
                for j in self.neighbours(i) {
                    if !seen[j] && self.holds(i, j) {
                        seen[j] = true;
                        piece.push(j);
                    }
                }
            }
            pieces.push(piece);
        }
        pieces
    }

    /// A piece's depths, less rough.
    fn smoothed(&self, piece: &[usize]) -> Vec<Option<f64>> {
        let mut depth = vec![None; self.depth.len()];
        for i in piece {
            depth[*i] = self.depth[*i];
        }
        for _ in 0..SMOOTHED {
            let before = depth.clone();
            for i in piece {
                let near = self.neighbours(*i).filter(|j| self.holds(*i, *j)).filter_map(|j| before[j]);
                let (sum, n) = near.chain(before[*i]).fold((0.0, 0.0), |(sum, n), d| (sum + d, n + 1.0));
                depth[*i] = Some(sum / n);
            }
        }
        depth
    }

    /// Goes on straight down to the floor from where a piece nearly reaches it: points that near to the floor are the
    /// floor's, and a thing that ends there would float.
    fn down_to_the_floor(&self, depth: &mut [Option<f64>], piece: &[usize]) {
        let width = self.size.width as usize;
        let eye = self.camera.centre();
        for i in piece {
            let (mut below, Some(own)) = (i + width, depth[*i]) else { continue };
            let foot = self.camera.unproject(self.place(*i), own);
            let away = (foot - eye).with_y(0.0).length();
            if foot.y > STANDS {
                continue;
            }
            while below < depth.len() && depth[below].is_none() && self.depth[below].is_none() {
                let ray = self.camera.ray(self.place(below));
                let along = away / ray.direction.with_y(0.0).length().max(1e-9);
                let point = ray.origin + ray.direction * along;
                if point.y < 0.0 {
                    break;
                }
                depth[below] = Some(self.camera.depth(point));
                below += width;
            }
        }
    }

    /// The sheet through a piece's points, with the photo on it; `None` when no triangle is left of it.
    fn relief(&self, piece: &[usize], photo: &RgbImage, max_faces: usize) -> Option<Relief> {
        let (w, h) = (self.size.width as usize, self.size.height as usize);
        let mut depth = self.smoothed(piece);
        self.down_to_the_floor(&mut depth, piece);
        let mask =
            Mask::from_fn(self.size, |x, y| depth[y as usize * w + x as usize].is_some()).resized(self.camera.size);
        let (texture, crop) = crop_of(photo, &mask)?;
        let stride = (2.0 * piece.len() as f64 / max_faces.max(1) as f64).sqrt().ceil().max(1.0) as usize;
        let mut mesh = Mesh::default();
        let mut vertex = vec![u32::MAX; depth.len()];
        let mut vertex_of = |mesh: &mut Mesh, i: usize| {
            if vertex[i] == u32::MAX {
                vertex[i] = mesh.positions.len() as u32;
                let at = self.place(i);
                mesh.positions.push(self.camera.unproject(at, depth[i].unwrap_or_default()).as_vec3());
                let uv = (at - DVec2::new(crop.x0, crop.y0)) / DVec2::new(crop.width(), crop.height());
                mesh.uvs.push(Vec2::new(uv.x as f32, uv.y as f32));
            }
            vertex[i]
        };
        let mut triangles = Vec::new();
        for y in (0..h.saturating_sub(stride)).step_by(stride) {
            for x in (0..w.saturating_sub(stride)).step_by(stride) {
                let a = y * w + x;
                let [b, c, d] = [a + stride * w, a + stride, a + stride * w + stride];
                for corners in cut([a, b, c, d], |p, q| is_near(depth[p], depth[q])) {
                    triangles.push(corners.map(|i| vertex_of(&mut mesh, i)));
                }
            }
        }
        if triangles.is_empty() {
            return None;
        }
        let mut paint = Material::plain(LABEL, [1.0; 3]);
        paint.texture = Some(Arc::new(DynamicImage::ImageRgb8(texture).to_rgba8()));
        paint.roughness = 0.9;
        paint.double_sided = true;
        mesh.materials.push(paint);
        mesh.groups.push(Group { material: 0, triangles });
        let bounds = mesh.bounds()?;
        let (low, high) = (bounds.min, bounds.max);
        let at = low.midpoint(high).with_y(low.y);
        for p in &mut mesh.positions {
            *p -= at.as_vec3();
        }
        mesh.recompute_normals();
        Some(Relief { mask, mesh, at })
    }
}

/// Whether two depths are of one thing.
fn is_near(a: Option<f64>, b: Option<f64>) -> bool {
    matches!((a, b), (Some(a), Some(b)) if (a - b).abs() < STEP.max(STEP_SHARE * a.min(b)))
}

/// The triangles of a cell of the grid (left above, left below, right above, right below), counter-clockwise from the
/// photo's side; none across a step in depth.
fn cut([a, b, c, d]: [usize; 4], holds: impl Fn(usize, usize) -> bool) -> Vec<[usize; 3]> {
    let whole = |t: &[usize; 3]| holds(t[0], t[1]) && holds(t[1], t[2]) && holds(t[2], t[0]);
    let kept = |ways: [[usize; 3]; 2]| -> Vec<[usize; 3]> { ways.into_iter().filter(whole).collect() };
    let (one, other) = (kept([[a, b, c], [c, b, d]]), kept([[a, b, d], [a, d, c]]));
    if other.len() > one.len() { other } else { one }
}

/// The part of the photo that a mask covers, and where it is, whole pixels.
fn crop_of(photo: &RgbImage, mask: &Mask) -> Option<(RgbImage, PixelBox)> {
    let b = mask.bounds()?;
    let size = mask.size();
    let (x0, y0) = ((b.x0.floor() - 1.0).max(0.0) as u32, (b.y0.floor() - 1.0).max(0.0) as u32);
    let (x1, y1) = ((b.x1.ceil() as u32 + 1).min(size.width), (b.y1.ceil() as u32 + 1).min(size.height));
    let crop = image::imageops::crop_imm(photo, x0, y0, x1 - x0, y1 - y0).to_image();
    Some((crop, PixelBox { x0: f64::from(x0), y0: f64::from(y0), x1: f64::from(x1), y1: f64::from(y1) }))
}

/// Puts a piece into the scene, as a thing of the furniture's level.
fn add(state: &mut SceneState, id: ObjectId, relief: Relief) {
    let Relief { mask, mesh, at } = relief;
    let (Some(bounds), Some(seen)) = (mesh.bounds(), mask.bounds()) else { return };
    let size = Size::from_vec(bounds.size());
    let support = support(&state.partial.room, at, bounds.size());
    let mesh = Arc::new(mesh);
    let shape = Arc::new(Shape::from_parts(Arc::clone(&mesh), None, bounds.size().max_element()));
    let phrase = "what the point map shows and nobody named".to_owned();
    let detection = Detection { label: LABEL.to_owned(), phrase, bounds: seen, score: None, outline: None };
    let mut object = Object::found(id.clone(), Level::Furniture, detection, mask);
    object.index = state.next_index;
    state.next_index += 1;
    object.said.size_m = InspectedSize { width: size.width, height: size.height, depth: size.depth };
    object.model = Some(Model {
        mesh,
        shape: Arc::clone(&shape),
        part_model: None,
        program: None,
        plain_slots: Vec::new(),
        said_slots: Vec::new(),
        bulb: None,
        moves: false,
        source: "relief of the point map".to_owned(),
        material: harmony_lighting::material_for(LABEL, size, None).0,
    });
    let item = Item {
        id: id.clone(),
        index: object.index,
        level: object.level,
        label: LABEL.to_owned(),
        shape,
        size,
        mask: Arc::clone(&object.mask),
        relations: Relations::default(),
        placement: Placement::default(),
        host_candidates: Vec::new(),
        traits: Traits::default(),
        yaw: YawHint::Unknown,
        detection: None,
    };
    let placed = Placed { item: Arc::new(item), pose: Pose::new(at, 0.0, 1.0), support, evidence: Evidence::default() };
    state.partial.placed.push(placed);
    state.objects.insert(id, object);
}

/// What carries a piece: the floor when it reaches down to it, else the nearest of walls and ceiling.
fn support(room: &Room, at: DVec3, size: DVec3) -> Support {
    if at.y <= STANDS {
        return Support::Floor;
    }
    let e: &Extents = &room.extents;
    let half = DVec3::new(size.x / 2.0, 0.0, size.z / 2.0);
    let corners = [at - half, at + half];
    let gap = |wall: Wall| corners.iter().map(|c| wall.distance(e, *c)).fold(f64::INFINITY, f64::min);
    let wall = [Wall::Back, Wall::Left, Wall::Right, Wall::Front]
        .into_iter()
        .min_by(|a, b| gap(*a).total_cmp(&gap(*b)))
        .unwrap_or(Wall::Back);
    if e.height - (at.y + size.y) < gap(wall) { Support::Ceiling } else { Support::Wall { wall } }
}

#[cfg(test)]
mod tests {
    use harmony_scene::PointMapKind;

    use super::*;
    use crate::testing::empty_room;

    /// A room with a chest before its back wall and a ball nearer to the camera that hides a part of it, as points.
    fn seen() -> SceneState {
        let mut state = empty_room();
        let camera = state.partial.camera;
        let faces = state.partial.room.faces();
        let xyz = (0..camera.size.pixels())
            .map(|i| {
                let (x, y) = (i % camera.size.width as usize, i / camera.size.width as usize);
                let ray = camera.ray(DVec2::new(x as f64 + 0.5, y as f64 + 0.5));
                let wall = faces.exit(&ray).map_or(DVec3::NAN, |hit| hit.point);
                let at = |z: f64| ray.origin + ray.direction * ((z - ray.origin.z) / ray.direction.z);
                let (chest, ball) = (at(0.6), at(2.0));
                if (ball - DVec3::new(2.2, 0.9, 2.0)).length() < 0.25 {
                    ball
                } else if (1.4..3.0).contains(&chest.x) && (0.0..1.2).contains(&chest.y) {
                    chest
                } else {
                    wall
                }
            })
            .collect();
        let confidence = vec![1.0; camera.size.pixels()];
        state.partial.points = Some(RoomPoints { kind: PointMapKind::Metric, size: camera.size, xyz, confidence });
        state
    }

    #[test]
    fn what_stands_before_a_wall_is_a_piece_of_its_own_where_it_is() {
        let state = seen();
        let found = reliefs(&state, 20_000);
        assert_eq!(found.len(), 2, "the chest is one piece around the ball, for nothing cuts it in two");
        let chest = &found[0];
        let size = chest.mesh.bounds().unwrap().size();
        assert!((chest.at - DVec3::new(2.2, 0.0, 0.6)).abs().max_element() < 0.06, "{:?}", chest.at);
        assert!((size - DVec3::new(1.6, 1.2, 0.0)).abs().max_element() < 0.08, "{size:?}");
        let ball = &found[1];
        assert!((ball.at - DVec3::new(2.2, 0.65, 2.0)).abs().max_element() < 0.04, "{:?}", ball.at);
        assert_eq!(chest.mask.and(&ball.mask).count(), 0);
        // Normals look at the camera.
        assert!(chest.mesh.normals.iter().all(|n| n.z > 0.9));
    }

    #[test]
    fn pieces_are_no_finer_than_asked_and_become_objects_that_draw_where_they_were_seen() {
        let mut state = seen();
        let relief = reliefs(&state, 2_000).swap_remove(0);
        assert!(relief.mesh.triangle_count() <= 2_000);
        let mask = relief.mask.clone();
        let id = ObjectId::numbered(LABEL, 1);
        add(&mut state, id.clone(), relief);
        assert_eq!(state.partial.find(&id).unwrap().support, Support::Floor);
        let drawn = crate::views::ids(&state);
        let shown =
            Mask::from_fn(mask.size(), |x, y| drawn[(y * mask.size().width + x) as usize] == state.objects[&id].index);
        assert!(shown.iou(&mask) > 0.9, "{}", shown.iou(&mask));
    }

    #[test]
    fn what_hangs_is_held_by_what_is_nearest() {
        let room = empty_room().partial.room;
        let size = DVec3::splat(0.4);
        assert_eq!(support(&room, DVec3::new(0.3, 1.0, 2.0), size), Support::Wall { wall: Wall::Left });
        assert_eq!(support(&room, DVec3::new(2.0, 2.0, 2.5), size), Support::Ceiling);
        assert_eq!(support(&room, DVec3::new(2.0, 0.1, 0.3), size), Support::Floor);
    }

    #[test]
    fn no_triangle_spans_a_step() {
        let steps = |a: usize, b: usize| (a < 3) == (b < 3);
        assert_eq!(cut([0, 1, 2, 3], steps), [[0, 1, 2]]);
        assert_eq!(cut([0, 1, 2, 3], |_, _| true).len(), 2);
        assert!(cut([0, 1, 2, 3], |_, _| false).is_empty());
    }
}
