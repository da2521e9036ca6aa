//! The language model's answers from the truth.

use std::collections::BTreeMap;

use async_trait::async_trait;
use glam::{DVec2, DVec3};
use harmony_prompts::{
    BackWallSide, FrontPanel, FrontsAnswer, FrontsObject, InspectAnswer, InspectQuestion, InspectedObject,
    InspectedSize, LayoutAnswer, LayoutFeature, LayoutFeatureKind, LayoutOpening, LayoutOpeningKind, LayoutPin,
    LayoutReach, LayoutWall, ListAnswer, ListedInstance, ListedItem, NamedObject, Occlusion, PinKind, Question,
};
use harmony_roles::{PlayerCard, RoleError, Usage, VisionLanguage, VlmAnswer, VlmRequest};
use harmony_scene::{
    DepthPosition, Level, Niche, Opening, PlacementType, Support, Surface, SurfacePosition, Wall, WallAffinity,
};
use rand::Rng;
use serde_json::{Value, json};

use super::{Oracle, card, normal, synonym};
use crate::truth::TruthObject;

/// Name of the set that an object would be of.
fn set_name(object: &TruthObject) -> String {
    format!("{} set {:.2}", object.label, object.size.y)
}

/// Twice the area of an outline.
fn area(outline: &[[f64; 2]]) -> f64 {
    let n = outline.len();
    let cross = |i: usize| outline[i][0] * outline[(i + 1) % n][1] - outline[i][1] * outline[(i + 1) % n][0];
    (0..n).map(cross).sum::<f64>().abs()
}

#[async_trait]
impl VisionLanguage for Oracle {
    fn card(&self) -> PlayerCard {
        card("language")
    }

    async fn ask(&self, request: &VlmRequest) -> Result<VlmAnswer, RoleError> {
        let answer = request.question.as_deref().and_then(|question| self.answer(question));
        let value = answer.ok_or_else(|| RoleError::NotCapable {
            player: "oracle".to_owned(),
            reason: format!("{} is a question that the truth does not answer", request.name),
        })?;
        Ok(VlmAnswer { raw: value.to_string(), value, usage: Usage::default() })
    }
}

impl Oracle {
    /// The answer to a question; `None` for one that the truth does not answer.
    pub fn answer(&self, question: &Question) -> Option<Value> {
        self.spent.measured(|| match question {
            Question::Layout(_) => Some(json!(self.layout())),
            Question::List(question) => Some(json!(self.list(question.level, question.with_boxes))),
            Question::Inspect(question) => Some(json!(self.inspect(question))),
            Question::Fronts(question) => Some(json!(self.fronts(&question.objects))),
            Question::Orient(question) => Some(json!(self.orient(&question.objects))),
            Question::Turns(question) => Some(json!(self.turns(question))),
            Question::Hosts(question) => Some(json!(self.hosts(question))),
            Question::Groups(question) => Some(json!(self.groups(question))),
            Question::Missing(question) => Some(json!(self.missing(question))),
            Question::Counts(question) => Some(json!(self.counts(question))),
            Question::Reorder(question) => Some(json!(self.reorder(question))),
            Question::Review(question) => Some(json!(self.review(question))),
            Question::Lights(question) => Some(self.lights(&question.lighting)),
            // The truth has no completed pictures.
            Question::Completed(_) => None,
            // It writes no programs, has nothing against the shapes that there are, and confirms what was measured.
            question => question.without_looking(),
        })
    }

    /// A relative error of one sigma.
    pub(super) fn factor(&self, purpose: &str, sigma: f64) -> f64 {
        1.0 + sigma * self.draws.normal(purpose).clamp(-2.5, 2.5)
    }

    /// The layout answer as calibration gets it, pixels of the truth's photo.
    pub fn layout_prior(&self) -> harmony_geometry::LayoutPrior {
        harmony_pipeline::layout_prior(&self.layout(), self.room.camera.size)
    }

    fn layout(&self) -> LayoutAnswer {
        let (room, camera, noise) = (&self.room, &self.room.camera, &self.noise);
        let mut answer = LayoutAnswer::example();
        let height = if self.exact_height { 1.0 } else { self.factor("height", noise.height) };
        room.name.trim_end_matches(|c: char| c.is_ascii_digit() || c == '_').clone_into(&mut answer.room.room_type);
        answer.room.ceiling_height_m = room.extents.height * height;
        answer.room.floor_width_m = room.extents.width * self.factor("width", noise.extent);
        answer.room.floor_depth_m = room.extents.depth * self.factor("depth", noise.extent);
        answer.walls = self.walls();
        // The example's materials are another room's.
        answer.surfaces.clear();
        answer.shape = self.shape();
        let untold = |f: &LayoutFeature| {
            self.draws.happens(&format!("untold {} {:?}", f.what, f.wall), self.noise.features_untold)
        };
        answer.shape.retain(|f| !untold(f));
        answer.trims = harmony_prompts::LayoutTrims::default();
        let (forward, centre) = (camera.forward(), camera.centre());
        let degrees = |purpose: &str| 50.0 * noise.hints * self.draws.normal(purpose).clamp(-2.5, 2.5);
        let c = &mut answer.camera;
        c.height_m = centre.y * self.factor("camera height", noise.hints);
        c.tilt_deg = (-forward.y).clamp(-1.0, 1.0).asin().to_degrees() + degrees("tilt");
        c.yaw_deg = (-forward.x).atan2(-forward.z).to_degrees() + degrees("yaw");
        c.dist_to_back_m = centre.z * self.factor("dist", noise.hints);
        let per_mille =
            |p: DVec2| [p.x * 1000.0 / f64::from(camera.size.width), p.y * 1000.0 / f64::from(camera.size.height)];
        let shaken = |p: DVec2, purpose: &str| {
            let mut rng = self.draws.rng(purpose);
            let long = f64::from(camera.size.width.max(camera.size.height));
            p + DVec2::new(normal(&mut rng), normal(&mut rng)) * noise.pins * long
        };
        c.corner_px = None;
        c.back_wall_side = BackWallSide::Both;
        if let Some((wall, pixel)) = room.seen_corner() {
            c.corner_px = Some(per_mille(shaken(pixel, "corner")));
            c.back_wall_side = if wall == Wall::Left { BackWallSide::Right } else { BackWallSide::Left };
        }
        let foot = camera.project(DVec3::new(centre.x, 0.0, 0.0)).unwrap_or(DVec2::new(0.0, 0.6));
        c.floor_junction_y_frac = shaken(foot, "junction").y / f64::from(camera.size.height);
        c.visible_wall_height_m = answer.room.ceiling_height_m;
        answer.pins = self
            .pins()
            .into_iter()
            .map(|(edge, points)| {
                let points = points.into_iter().enumerate();
                let points = points.map(|(i, p)| per_mille(shaken(p, &format!("pin {edge:?} {i}")))).collect();
                LayoutPin { edge, points }
            })
            .collect();
        answer
    }

    /// Ends of the room's edges as far as they are in the image and nothing stands before them.
    fn pins(&self) -> Vec<(PinKind, Vec<DVec2>)> {
        let e = self.room.extents;
        let (room, middle) = (self.room.room(), e.as_vec() / 2.0);
        let (w, h, d) = (e.width, e.height, e.depth);
        let edges = [
            (PinKind::FloorBack, DVec3::ZERO, DVec3::new(w, 0.0, 0.0)),
            (PinKind::FloorLeft, DVec3::ZERO, DVec3::new(0.0, 0.0, d)),
            (PinKind::FloorRight, DVec3::new(w, 0.0, 0.0), DVec3::new(w, 0.0, d)),
            (PinKind::CeilingBack, DVec3::new(0.0, h, 0.0), DVec3::new(w, h, 0.0)),
            (PinKind::CeilingLeft, DVec3::new(0.0, h, 0.0), DVec3::new(0.0, h, d)),
            (PinKind::CeilingRight, DVec3::new(w, h, 0.0), DVec3::new(w, h, d)),
            (PinKind::BackLeft, DVec3::ZERO, DVec3::new(0.0, h, 0.0)),
            (PinKind::BackRight, DVec3::new(w, 0.0, 0.0), DVec3::new(w, h, 0.0)),
        ];
        edges
            .into_iter()
            .filter_map(|(kind, a, b)| {
                let seen: Vec<DVec2> = (0..=60)
                    .map(|i| a.lerp(b, f64::from(i) / 60.0))
                    .filter(|p| room.is_free(*p + (middle - *p).normalize() * 0.02))
                    .filter_map(|p| self.seen_pixel(p))
                    .collect();
                let (first, last) = (*seen.first()?, *seen.last()?);
                (first.distance(last) > 0.05 * f64::from(self.room.camera.size.width))
                    .then(|| (kind, vec![first, last]))
            })
            .collect()
    }

    /// Where a point of the shell is seen, if nothing hides it.
    fn seen_pixel(&self, at: DVec3) -> Option<DVec2> {
        let camera = &self.room.camera;
        let pixel = camera.project(at).filter(|p| camera.contains(*p))?;
        let z = self.room.depth[pixel.y as usize * camera.size.width as usize + pixel.x as usize];
        (f64::from(z) > camera.depth(at) - 0.12).then_some(pixel)
    }

    /// The walls that have passages in the picture, with these alone: nothing else of a wall is asked for its own sake.
    fn walls(&self) -> Vec<LayoutWall> {
        let e = &self.room.extents;
        let passages = |wall: Wall| {
            let own = self.room.openings.iter().enumerate().filter(|(_, o)| o.is_passage() && o.wall == wall);
            let one = |(k, o): (usize, &Opening)| {
                let plane = harmony_scene::WallPlane { wall, inset: o.inset };
                let corners: Vec<DVec3> = o.outline().iter().map(|p| plane.point(e, p.x, p.y)).collect();
                let before = plane.distance(e, self.room.camera.centre()) > 0.0;
                let face = if before { self.outline(&format!("passage {k}"), &corners) } else { Vec::new() };
                let size = |purpose: &str| self.factor(&format!("{purpose} of passage {k}"), self.noise.extent);
                let opening = LayoutOpening {
                    kind: LayoutOpeningKind::Passage,
                    width_m: (o.u[1] - o.u[0]) * size("width"),
                    height_m: (o.y[1] - o.y[0]) * size("height"),
                    offset_m: o.u[0].max(0.0),
                    arch_m: (o.rounded() > 0.0).then(|| o.rounded() * size("arch")),
                    face,
                };
                (opening.face.len() > 2).then_some(opening)
            };
            own.filter_map(one).collect::<Vec<_>>()
        };
        Wall::ALL
            .into_iter()
            .map(|wall| LayoutWall {
                orientation: wall,
                length_m: wall.length(e) * self.factor(&format!("length of {wall:?}"), self.noise.extent),
                height_m: e.height,
                surface: String::new(),
                openings: passages(wall),
            })
            .filter(|w| !w.openings.is_empty())
            .collect()
    }

    /// Where the room is not a box: the faces that are in the picture.
    fn shape(&self) -> Vec<LayoutFeature> {
        let (room, e, truth) = (self.room.room(), &self.room.extents, &self.room.shape);
        let mut out = Vec::new();
        for (k, block) in truth.blocks.iter().enumerate() {
            let touched = |w: &Wall| w.distance(e, block.min).min(w.distance(e, block.max)) < 1e-3;
            // Of two walls that a corner touches, the one whose side shows more.
            let sides = Wall::ALL.into_iter().filter(touched).map(|wall| {
                let depth = wall.distance(e, block.min).max(wall.distance(e, block.max));
                (wall, depth, self.face(k, wall, depth, block.min, block.max))
            });
            let best = sides.max_by(|a, b| area(&a.2).total_cmp(&area(&b.2)));
            if let Some((wall, depth, face)) = best.filter(|b| b.2.len() > 2) {
                let feature = LayoutFeatureKind::Block;
                out.push(self.feature(feature, &block.kind, wall, face, depth, (block.min, block.max)));
            }
        }
        for (k, niche) in truth.niches.iter().enumerate() {
            let Some(wall) = niche.surface.wall() else {
                out.extend(self.tray(k, niche));
                continue;
            };
            let depth = -wall.distance(e, niche.min).min(wall.distance(e, niche.max));
            let face = self.face(100 + k, wall, 0.0, niche.min, niche.max);
            if face.len() > 2 && depth > 0.0 {
                let feature = LayoutFeatureKind::Niche;
                out.push(self.feature(feature, &niche.kind, wall, face, depth, (niche.min, niche.max)));
            }
        }
        for (k, slope) in truth.slopes.iter().enumerate() {
            let normal = slope.normal(e);
            let own = |f: &&harmony_scene::RoomFace| f.normal.dot(normal) > 0.999;
            let corners: Vec<DVec3> = room.all_faces().iter().find(own).map_or_else(Vec::new, |f| f.polygon.clone());
            let face = self.outline(&format!("slope {k}"), &corners);
            if face.len() > 2 {
                let end = (DVec3::ZERO, DVec3::ZERO);
                let mut feature = self.feature(LayoutFeatureKind::Slope, "slope", slope.wall, face, slope.run, end);
                feature.low_m = Some(slope.low * self.factor("slope", self.noise.hints));
                feature.reaches.clear();
                out.push(feature);
            }
        }
        out
    }

    /// A recess in the ceiling, where its opening is in the picture.
    fn tray(&self, k: usize, niche: &Niche) -> Option<LayoutFeature> {
        let (a, b, y) = (niche.min, niche.max, niche.min.y);
        let corners = [(a.x, a.z), (b.x, a.z), (b.x, b.z), (a.x, b.z)].map(|(x, z)| DVec3::new(x, y, z));
        let face = self.outline(&format!("tray {k}"), &corners);
        let seen = face.len() > 2 && niche.surface == Surface::Ceiling;
        seen.then(|| {
            let end = (DVec3::ZERO, DVec3::ZERO);
            let tray = LayoutFeatureKind::Tray;
            let mut feature = self.feature(tray, &niche.kind, Wall::Back, face, niche.max.y - y, end);
            feature.reaches.clear();
            feature
        })
    }

    /// Outline of the side of a box that looks as a wall does, in thousandths.
    fn face(&self, k: usize, wall: Wall, depth: f64, min: DVec3, max: DVec3) -> Vec<[f64; 2]> {
        let e = &self.room.extents;
        if wall.distance(e, self.room.camera.centre()) <= depth {
            return Vec::new();
        }
        let (a, b) = (wall.coordinates(min), wall.coordinates(max));
        let corners = [[a.x, a.y], [b.x, a.y], [b.x, b.y], [a.x, b.y]];
        let corners = corners.map(|[u, y]| wall.point(e, u, y) + wall.normal() * depth);
        self.outline(&format!("face {k} {wall:?}"), &corners)
    }

    /// Outline of a polygon of the room in the photo, as far as it is in the picture, in thousandths.
    fn outline(&self, purpose: &str, corners: &[DVec3]) -> Vec<[f64; 2]> {
        let camera = &self.room.camera;
        let (w, h) = (f64::from(camera.size.width), f64::from(camera.size.height));
        let before = harmony_scene::clipped(corners, |p| camera.depth(p) - 0.1);
        let flat: Vec<DVec3> = before.iter().filter_map(|p| camera.project(*p)).map(|p| p.extend(0.0)).collect();
        let inside = harmony_scene::clipped(&flat, |p| p.x);
        let inside = harmony_scene::clipped(&inside, |p| w - p.x);
        let inside = harmony_scene::clipped(&inside, |p| p.y);
        let inside = harmony_scene::clipped(&inside, |p| h - p.y);
        let mut rng = self.draws.rng(purpose);
        inside
            .iter()
            .map(|p| {
                let shaken = p.truncate() + DVec2::new(normal(&mut rng), normal(&mut rng)) * self.noise.pins * w.max(h);
                [shaken.x * 1000.0 / w, shaken.y * 1000.0 / h]
            })
            .collect()
    }

    fn feature(
        &self,
        kind: LayoutFeatureKind,
        what: &str,
        wall: Wall,
        face: Vec<[f64; 2]>,
        depth: f64,
        (min, max): (DVec3, DVec3),
    ) -> LayoutFeature {
        let e = &self.room.extents;
        let (a, b) = (wall.coordinates(min), wall.coordinates(max));
        let low_is_left = wall.runs_to_the_right();
        let (low, high) = (a.x < 0.02, b.x > wall.length(e) - 0.02);
        let (left, right) = if low_is_left { (low, high) } else { (high, low) };
        let reaches = [
            (a.y < 0.02, LayoutReach::Floor),
            (b.y > e.height - 0.02, LayoutReach::Ceiling),
            (left, LayoutReach::LeftEnd),
            (right, LayoutReach::RightEnd),
        ];
        LayoutFeature {
            kind,
            what: what.replace('_', " "),
            wall,
            face,
            depth_m: depth * self.factor(&format!("depth of {what}"), self.noise.extent),
            reaches: reaches.into_iter().filter(|r| r.0).map(|r| r.1).collect(),
            low_m: None,
            glow_hex: None,
        }
    }

    fn list(&self, level: Level, with_boxes: bool) -> ListAnswer {
        let mut counts: BTreeMap<&str, Vec<usize>> = BTreeMap::new();
        for i in self.seen(level).filter(|i| !self.overlooks(&self.room.objects[*i].id)) {
            counts.entry(&self.room.objects[i].label).or_default().push(i);
        }
        let mut items = Vec::new();
        for (label, members) in counts {
            let instances: Vec<ListedInstance> =
                members.iter().filter(|_| with_boxes).filter_map(|i| self.instance(*i)).collect();
            let item = |kind: &str| ListedItem {
                kind: kind.into(),
                gdino: kind.into(),
                count: members.len() as u32,
                instances: instances.clone(),
            };
            let other = synonym(label);
            let renamed = self.draws.happens(&format!("synonym {label}"), self.noise.synonyms);
            items.push(item(other.filter(|_| renamed).unwrap_or(label)));
            let twice = self.draws.happens(&format!("duplicate {label}"), self.noise.duplicates);
            if let Some(other) = other.filter(|_| twice && !renamed) {
                items.push(item(other));
            }
        }
        ListAnswer { items }
    }

    /// The box that a language model gives for an object: less exact than a detector's, and some it does not see either.
    fn instance(&self, object: usize) -> Option<ListedInstance> {
        let (id, size) = (&self.room.objects[object].id, self.room.camera.size);
        if self.draws.happens(&format!("no box {id}"), self.noise.merged_or_missed / 2.0) {
            return None;
        }
        let b = self.box_off(object, 2.0, &mut self.draws.rng(&format!("listed box {id}")))?.clamped(size);
        let (kx, ky) = (1000.0 / f64::from(size.width), 1000.0 / f64::from(size.height));
        let bounds = [b.x0 * kx, b.y0 * ky, b.x1 * kx, b.y1 * ky];
        let wide = bounds[2] - bounds[0] >= 1.0 && bounds[3] - bounds[1] >= 1.0;
        wide.then_some(ListedInstance { bounds, outline: Vec::new(), pieces: Vec::new(), host: None })
    }

    fn inspect(&self, question: &InspectQuestion) -> InspectAnswer {
        let candidates = question.candidates.iter().chain(&question.others);
        let mut shown: Vec<(String, String, Option<usize>)> = candidates
            .map(|c| {
                let object = self.recognise(Some(question.level), &c.label, &c.bounds, c.image);
                (c.id.to_string(), c.label.clone(), object)
            })
            .collect();
        self.exchange(&mut shown);
        for (id, _, object) in &shown {
            if let Some(object) = object {
                self.remember(id, *object);
            }
        }
        let ids: Vec<String> = shown.iter().map(|(id, ..)| id.clone()).collect();
        shown.truncate(question.candidates.len());
        let placed: Vec<String> = question.placed.iter().map(|known| known.id().to_string()).collect();
        let objects: Vec<InspectedObject> = shown
            .iter()
            .map(|(id, label, object)| {
                if let Some(i) = object {
                    self.inspected(id, label, &self.room.objects[*i], &ids, &placed)
                } else {
                    let size = InspectedSize { width: 0.5, height: 0.5, depth: 0.5 };
                    let mut unknown = InspectedObject::plain(id, label, size);
                    unknown.keep = false;
                    unknown.reason = "nothing of this kind is there".into();
                    unknown
                }
            })
            .collect();
        let mut order = self.away_from_corner(shown.iter().filter_map(|(id, _, o)| Some((id.as_str(), (*o)?))));
        let level = question.level.folder();
        if self.draws.happens(&format!("disordered {level}"), self.noise.disordered) {
            order.sort_by_key(|id| self.draws.rng(&format!("place of {id}")).random::<u64>());
        }
        InspectAnswer {
            objects,
            placement_order: order,
            scene_summary: format!("{} objects in a {}", shown.len(), self.room.name),
        }
    }

    /// The paper's order: ids of objects, away from the deepest corner.
    pub(super) fn away_from_corner<'a>(&self, objects: impl Iterator<Item = (&'a str, usize)>) -> Vec<String> {
        let corner = match self.room.seen_corner() {
            Some((Wall::Right, _)) => DVec3::new(self.room.extents.width, 0.0, 0.0),
            _ => DVec3::ZERO,
        };
        let far = |(id, i): (&str, usize)| {
            let far = self.room.objects[i].position.distance(corner);
            (far * self.factor(&format!("order {id}"), self.noise.extent), id.to_owned())
        };
        let mut order: Vec<(f64, String)> = objects.map(far).collect();
        order.sort_by(|a, b| a.0.total_cmp(&b.0));
        order.into_iter().map(|(_, id)| id).collect()
    }

    /// Takes the outermost two members of some sets for each other.
    fn exchange(&self, shown: &mut [(String, String, Option<usize>)]) {
        let mut sets: BTreeMap<String, Vec<usize>> = BTreeMap::new();
        for (k, (_, _, object)) in shown.iter().enumerate() {
            if let Some(object) = object.map(|i| &self.room.objects[i]) {
                sets.entry(format!("{} {}", set_name(object), object.model)).or_default().push(k);
            }
        }
        for (name, mut members) in sets {
            // The same two in every question about the level.
            members.sort_by(|a, b| shown[*a].0.cmp(&shown[*b].0));
            let [first, .., last] = members[..] else { continue };
            if self.draws.happens(&format!("swapped {name}"), self.noise.swapped) {
                let (one, other) = (shown[first].2, shown[last].2);
                (shown[first].2, shown[last].2) = (other, one);
            }
        }
    }

    fn inspected(
        &self,
        id: &str,
        label: &str,
        object: &TruthObject,
        candidates: &[String],
        placed: &[String],
    ) -> InspectedObject {
        let name = &object.id;
        let mut rng = self.draws.rng(&format!("size {name}"));
        let mut size = object.size;
        if self.noise.size > 0.0 {
            // Two thirds of the variance are common to the sides, so that each side's error has the whole sigma.
            let (common, own) = (self.noise.size * (2.0_f64 / 3.0).sqrt(), self.noise.size * (1.0_f64 / 3.0).sqrt());
            let shared = common * normal(&mut rng);
            size *=
                DVec3::from_array(std::array::from_fn(|_| (shared + own * normal(&mut rng)).clamp(-0.7, 0.7).exp()));
        }
        let mut o = InspectedObject::plain(
            id,
            label,
            InspectedSize { width: size.x, height: size.y, depth: size.z.max(0.002) },
        );
        o.description.clone_from(&object.label);
        o.occlusion = match object.occluded {
            v if v < 0.1 => Occlusion::None,
            v if v < 0.5 => Occlusion::Partly,
            _ => Occlusion::Heavily,
        };
        self.relate(&mut o, object, candidates, placed);
        o.front_deg = object.has_front().then(|| self.front_deg(object));
        o.faces_room = object.faces_room;
        let twins = self.room.visible().filter(|t| t.label == object.label && t.model == object.model);
        let twins: Vec<&TruthObject> = twins.filter(|t| (t.size - object.size).length() < 0.01).collect();
        if twins.len() > 1 {
            o.matched_set = Some(set_name(object));
            o.count = Some(twins.len() as u32);
        }
        o
    }

    fn relate(&self, o: &mut InspectedObject, object: &TruthObject, candidates: &[String], placed: &[String]) {
        let name = &object.id;
        let wrong = |what: &str| self.draws.happens(&format!("wrong {what} {name}"), self.noise.relations);
        let mut rng = self.draws.rng(&format!("relations {name}"));
        let walls = [WallAffinity::Back, WallAffinity::Left, WallAffinity::Right, WallAffinity::Centre];
        let affinity = object.wall.map_or(WallAffinity::Centre, WallAffinity::from);
        o.wall_affinity = if wrong("wall") { walls[rng.random_range(0..4)] } else { affinity };
        if let Support::Wall { wall } = object.support {
            let other = [Wall::Back, Wall::Left, Wall::Right][rng.random_range(0..3)];
            o.wall = Some(if wrong("support wall") { other } else { wall });
        }
        if let Support::Object { id: host } = &object.support {
            let right = self.id_of(host.as_str()).filter(|h| placed.contains(h) || candidates.contains(h));
            o.on_top_of = match right {
                Some(_) if wrong("host") && !placed.is_empty() => {
                    Some(placed[rng.random_range(0..placed.len())].clone())
                }
                other => other,
            };
            self.where_on_host(o, object, host.as_str());
        } else if let Some(ledge) = object.support.ledge() {
            let name = ledge.id().to_string();
            let of_its_kind = |id: &&String| id.split('_').next() == name.split('_').next();
            let same = placed.iter().find(|id| **id == name);
            o.on_top_of = same.or_else(|| placed.iter().find(of_its_kind)).cloned();
        } else if object.level == Level::Decoration {
            o.placement_type = PlacementType::OnFloor;
        }
        let facing = object.facing.as_ref().and_then(|f| self.id_of(f)).filter(|f| *f != o.id);
        o.facing_toward = facing.filter(|f| (candidates.contains(f) || placed.contains(f)) && !wrong("facing"));
        o.group.clone_from(&object.group);
    }

    /// Where on its host a decoration stands, as the camera sees it.
    fn where_on_host(&self, o: &mut InspectedObject, object: &TruthObject, host: &str) {
        let Some(host) = self.room.find(host) else { return };
        let camera = &self.room.camera;
        let reach = 0.5 * DVec2::new(host.size.x, host.size.z).length().max(0.1);
        let offset = object.position - host.position;
        let (right, forward) = (camera.right(), camera.forward());
        let across = offset.dot(right) / reach;
        let along = DVec3::new(forward.x, 0.0, forward.z).normalize_or(DVec3::NEG_Z).dot(offset) / reach;
        o.surface_position = match across {
            v if v < -0.33 => SurfacePosition::Left,
            v if v > 0.33 => SurfacePosition::Right,
            _ => SurfacePosition::Center,
        };
        o.depth_position = match along {
            v if v < -0.33 => DepthPosition::Front,
            v if v > 0.33 => DepthPosition::Back,
            _ => DepthPosition::Middle,
        };
    }

    /// Direction of a front in words of a language model: to 15 degrees, at times a quarter turn wrong.
    fn front_deg(&self, object: &TruthObject) -> f64 {
        let name = &object.id;
        let mut deg = object.yaw.to_degrees();
        if self.noise.front_deg > 0.0 {
            deg += self.noise.front_deg * self.draws.normal(&format!("front {name}"));
            deg = (deg / 15.0).round() * 15.0;
        }
        deg += 90.0 * f64::from(self.wrong_quarters(&format!("front turn {name}")));
        (deg + 180.0).rem_euclid(360.0) - 180.0
    }

    /// Quarter turns that an answer is wrong by: none, mostly.
    fn wrong_quarters(&self, purpose: &str) -> u32 {
        let mut rng = self.draws.rng(purpose);
        if rng.random::<f64>() < self.noise.turns { rng.random_range(1..4) } else { 0 }
    }

    /// The panel whose turn brings a generated mesh's front to +Z.
    fn fronts(&self, objects: &[NamedObject]) -> FrontsAnswer {
        self.panels(objects, |object, name| {
            let wrong = self.wrong_quarters(&format!("panel {name}"));
            (4 - self.quarters(object) + wrong) % 4
        })
    }

    /// Whether a placed decoration looks right: all but wrong turns are left as they are.
    fn orient(&self, objects: &[NamedObject]) -> FrontsAnswer {
        self.panels(objects, |_, name| self.wrong_quarters(&format!("orient {name}")))
    }

    fn panels(&self, objects: &[NamedObject], quarters: impl Fn(&TruthObject, &str) -> u32) -> FrontsAnswer {
        let mut objects: Vec<FrontsObject> = objects
            .iter()
            .map(|NamedObject { id, .. }| {
                let q = self.known(id).map_or(0, |object| quarters(object, &object.id));
                FrontsObject { front_panel: FrontPanel::ALL[q as usize % 4], id: id.clone() }
            })
            .collect();
        objects.sort_by(|a, b| a.id.cmp(&b.id));
        FrontsAnswer { objects }
    }

    /// An object by its id in the run.
    pub(super) fn known(&self, id: &str) -> Option<&TruthObject> {
        self.recall(id).map(|i| &self.room.objects[i])
    }

    /// Whether a label names what has a front that matters.
    pub(super) fn turns_matter(object: &TruthObject) -> bool {
        object.has_front() || harmony_catalogue::has_front(&object.label)
    }
}
