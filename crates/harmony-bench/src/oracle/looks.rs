//! What a second look finds, by the truth: hosts, small turns, order within sets, what is missing and what is too much. Each
//! fault is noticed as often as a reviewer notices one.

use std::collections::BTreeSet;

use glam::DVec3;
use harmony_pipeline::LookKind;
use harmony_prompts::{
    CountedKind, CountsAnswer, CountsQuestion, GroupSwap, GroupsAnswer, GroupsQuestion, HostsAnswer, HostsObject,
    HostsQuestion, InspectedSize, MissingAnswer, MissingDecoration, MissingInstance, MissingMember, MissingQuestion,
    ReorderAnswer, ReorderHost, ReorderQuestion, ReorderSize, TurnPanel, TurnsAnswer, TurnsObject, TurnsQuestion,
};
use harmony_scene::{Level, Support};

use super::Oracle;
use crate::truth::TruthObject;

/// A side so many times too long or too short is noticed.
const WRONG_SIZE: f64 = 1.25;
/// Overlap of boxes that show one thing.
const SAME_BOX: f64 = 0.3;

impl Oracle {
    /// Box of an object in thousandths, as a language model gives it.
    fn thousandths(&self, object: usize, purpose: &str) -> Option<[f64; 4]> {
        let size = self.room.camera.size;
        let b = self.box_off(object, 2.0, &mut self.draws.rng(purpose))?.clamped(size);
        let (kx, ky) = (1000.0 / f64::from(size.width), 1000.0 / f64::from(size.height));
        let bounds = [b.x0 * kx, b.y0 * ky, b.x1 * kx, b.y1 * ky];
        (bounds[2] - bounds[0] >= 1.0 && bounds[3] - bounds[1] >= 1.0).then_some(bounds)
    }

    pub(super) fn hosts(&self, question: &HostsQuestion) -> HostsAnswer {
        let objects = question.objects.iter().filter_map(|asked| {
            let object = self.known(asked.id.as_str())?;
            let Support::Object { id } = &object.support else { return None };
            let right =
                asked.candidates.iter().find(|c| self.known(c.as_str()).is_some_and(|o| o.id == id.as_str()))?;
            let wrong =
                asked.current.as_ref() != Some(right) && self.finds(LookKind::Hosts, &format!("host of {}", object.id));
            let reason = "it stands there in the photo".to_owned();
            wrong.then(|| HostsObject { id: asked.id.to_string(), host: right.to_string(), reason })
        });
        HostsAnswer { objects: objects.collect() }
    }

    /// The level's objects away from the deepest corner, and of those that stay in one another the right hosts and sizes.
    pub(super) fn reorder(&self, question: &ReorderQuestion) -> ReorderAnswer {
        let level = question.level.folder();
        for collision in &question.collisions {
            self.shown(LookKind::Reorder, &format!("{level}: {collision}"), true);
        }
        let named = |line: &str, id: &str| line.split([' ', ':']).any(|word| word == id);
        let colliding = |id: &str| question.collisions.iter().any(|line| named(line, id));
        let (mut hosts, mut sizes) = (Vec::new(), Vec::new());
        for row in question.placed.iter().filter(|row| question.order.contains(&row.id) && colliding(row.id.as_str())) {
            let Some(object) = self.known(row.id.as_str()) else { continue };
            let right = match &object.support {
                Support::Object { id } => self.id_of(id.as_str()),
                _ => None,
            };
            let is = match &row.support {
                Support::Object { id } => Some(id.to_string()),
                _ => None,
            };
            let can_be_said = right.as_ref().is_none_or(|id| question.placed.iter().any(|p| p.id.as_str() == id));
            if is != right && can_be_said && self.finds(LookKind::Reorder, &format!("{level}: host of {}", object.id)) {
                hosts.push(ReorderHost { id: row.id.to_string(), on_top_of: right });
            }
            let ratio = object.size / row.size.as_vec().max(DVec3::splat(1e-3));
            let off = ratio.max(1.0 / ratio).max_element();
            if off > WRONG_SIZE && self.finds(LookKind::Reorder, &format!("{level}: size of {}", object.id)) {
                let [width, height, depth] = object.size.max(DVec3::splat(0.002)).to_array();
                sizes.push(ReorderSize { id: row.id.to_string(), size_m: InspectedSize { width, height, depth } });
            }
        }
        let ids = question.order.iter().filter_map(|id| Some((id.as_str(), self.recall(id.as_str())?)));
        let placement_order = self.away_from_corner(ids);
        ReorderAnswer { placement_order, hosts, sizes, reason: "as the photo has them".into() }
    }

    pub(super) fn turns(&self, question: &TurnsQuestion) -> TurnsAnswer {
        let objects = question.objects.iter().filter_map(|asked| {
            let object = self.known(asked.id.as_str()).filter(|o| Self::turns_matter(o))?;
            let off = object.yaw.to_degrees() - asked.yaw_deg;
            let off = (off + 180.0).rem_euclid(360.0) - 180.0;
            let panel = match () {
                () if off.abs() <= question.step_deg / 2.0 || off.abs() > 3.0 * question.step_deg => return None,
                () if off > 0.0 => TurnPanel::B,
                () => TurnPanel::C,
            };
            let noticed = self.finds(LookKind::Turns, &format!("turn {} {}", object.id, question.step_deg));
            noticed.then(|| TurnsObject { id: asked.id.to_string(), panel })
        });
        TurnsAnswer { objects: objects.collect() }
    }

    pub(super) fn groups(&self, question: &GroupsQuestion) -> GroupsAnswer {
        let mut answer = GroupsAnswer::default();
        let across = |o: &TruthObject| self.room.camera.project(o.position).map_or(0.0, |p| p.x);
        for set in &question.sets {
            // Ids as they are placed from left to right, beside where each belongs.
            let mut order: Vec<(&str, f64)> =
                set.members.iter().filter_map(|id| Some((id.as_str(), across(self.known(id.as_str())?)))).collect();
            for i in 0..order.len() {
                let least = (i..order.len()).min_by(|a, b| order[*a].1.total_cmp(&order[*b].1)).unwrap_or(i);
                if least != i && self.finds(LookKind::Groups, &format!("order of {} {}", set.name, order[i].0)) {
                    answer.swaps.push(GroupSwap { id: order[i].0.to_owned(), with: order[least].0.to_owned() });
                    order.swap(i, least);
                }
            }
            let Some((like, one)) = set.members.iter().find_map(|id| Some((id, self.known(id.as_str())?))) else {
                continue;
            };
            for i in self.seen(one.level) {
                let twin = &self.room.objects[i];
                let absent = twin.model == one.model && twin.label == one.label && self.id_of(&twin.id).is_none();
                if absent && self.finds(LookKind::Groups, &format!("missing member {}", twin.id)) {
                    let bounds = self.thousandths(i, &format!("member box {}", twin.id));
                    let member = bounds.map(|bounds| MissingMember { like: like.to_string(), bounds });
                    answer.missing.extend(member);
                }
            }
        }
        answer
    }

    pub(super) fn missing(&self, question: &MissingQuestion) -> MissingAnswer {
        let mut answer = MissingAnswer { label: question.furniture.about.clone(), ..MissingAnswer::default() };
        let Some(host) = self.known(&question.furniture.id) else { return answer };
        for i in self.seen(Level::Decoration) {
            let object = &self.room.objects[i];
            let on_it = matches!(&object.support, Support::Object { id } if id.as_str() == host.id);
            let bounds = on_it.then(|| self.thousandths(i, &format!("missing box {}", object.id)));
            let Some(bounds) = bounds.flatten() else { continue };
            let there = |b: &[f64; 4]| pixel_box(*b).iou(&pixel_box(bounds)) > SAME_BOX;
            let absent = !question.present.iter().any(|p| there(&p.bounds));
            if absent && self.finds(LookKind::Missing, &format!("missing {}", object.id)) {
                let (name, description) = (object.label.clone(), object.label.clone());
                answer.missing_decorations.push(MissingDecoration { name, description, bounds });
            }
        }
        answer
    }

    pub(super) fn counts(&self, question: &CountsQuestion) -> CountsAnswer {
        let placed: BTreeSet<&str> = question.placed.iter().map(|p| p.id.as_str()).collect();
        let mut answer = CountsAnswer::default();
        for level in Level::ALL {
            let seen: Vec<usize> = self.seen(level).collect();
            let kinds: BTreeSet<&str> = seen.iter().map(|i| self.room.objects[*i].label.as_str()).collect();
            for kind in kinds {
                let of_kind = || seen.iter().copied().filter(|i| self.room.objects[*i].label == kind);
                let there = |i: usize| self.id_of(&self.room.objects[i].id).filter(|id| placed.contains(id.as_str()));
                let absent = of_kind().filter(|i| there(*i).is_none());
                let missing: Vec<MissingInstance> = absent
                    .filter(|i| self.finds(LookKind::Counts, &format!("count {}", self.room.objects[*i].id)))
                    .filter_map(|i| {
                        let object = &self.room.objects[i];
                        let bounds = self.thousandths(i, &format!("counted box {}", object.id))?;
                        let twin = |k: &usize| self.room.objects[*k].model == object.model;
                        let like = of_kind().filter(|k| *k != i && twin(k)).find_map(there);
                        let host = match &object.support {
                            Support::Object { id } => self.id_of(id.as_str()).filter(|h| placed.contains(h.as_str())),
                            Support::Floor
                            | Support::Ceiling
                            | Support::Wall { .. }
                            | Support::Block { .. }
                            | Support::Niche { .. } => None,
                        };
                        Some(MissingInstance { bounds, like, host })
                    })
                    .collect();
                if missing.is_empty() {
                    continue;
                }
                let photo = of_kind().count() as u32;
                let scene = of_kind().filter(|i| there(*i).is_some()).count() as u32;
                let kind = kind.to_owned();
                answer.kinds.push(CountedKind { kind, level, photo, scene, missing, surplus: Vec::new() });
            }
        }
        // What stands for nothing, or for what something else stands for already.
        let mut taken = BTreeSet::new();
        for row in &question.placed {
            let object = self.known(row.id.as_str());
            let surplus = object.is_none_or(|o| !taken.insert(o.id.clone()));
            if surplus && self.finds(LookKind::Counts, &format!("surplus {}", row.id)) {
                answer.kinds.push(CountedKind {
                    kind: row.label.clone(),
                    level: row.level,
                    photo: 0,
                    scene: 1,
                    missing: Vec::new(),
                    surplus: vec![row.id.to_string()],
                });
            }
        }
        answer
    }
}

fn pixel_box([x0, y0, x1, y1]: [f64; 4]) -> harmony_scene::PixelBox {
    harmony_scene::PixelBox { x0, y0, x1, y1 }
}
