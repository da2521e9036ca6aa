//! Openings that lead into nothing.

use glam::DVec2;
use harmony_scene::{OpeningKind, Wall};

use super::fitted::along;
use super::items::home_id;
use crate::home::{Conflict, Home};

/// A window this near to another room looks into it, metres.
const BEHIND_M: f64 = 0.6;

/// Windows that look into other rooms, and doors of runs that lead nowhere.
pub fn find_strays(home: &mut Home) {
    let mut out = Vec::new();
    for (k, room) in home.rooms.iter().enumerate() {
        let Some((run, evidence)) = &room.run else { continue };
        let place = &room.solved.place;
        for (o, opening) in run.world.scene.room.openings.iter().enumerate() {
            let side = place.turn.wall(opening.wall);
            let joined = home
                .doors
                .iter()
                .any(|d| d.rooms.iter().zip(&d.seen).any(|(r, s)| *r == k && s.is_some_and(|s| s.0 == o)));
            let object = opening.object.as_ref().map(|id| home_id(&room.name, id).to_string());
            match opening.kind {
                OpeningKind::Door if !joined => out.push(Conflict::DoorNowhere { room: room.name.clone(), object }),
                OpeningKind::Door => {}
                OpeningKind::Window => {
                    let middle = along(evidence, place, opening.wall, f64::midpoint(opening.u[0], opening.u[1]));
                    let outside = room.solved.rect.side(side) + crate::layout::outward(side) * BEHIND_M;
                    let at = if matches!(side, Wall::Left | Wall::Right) {
                        DVec2::new(outside, middle)
                    } else {
                        DVec2::new(middle, outside)
                    };
                    let behind = home.rooms.iter().enumerate();
                    let behind =
                        behind.filter(|(j, _)| *j != k).find(|(_, r)| r.free().iter().any(|f| f.contains(at, 0.0)));
                    if let Some((_, other)) = behind {
                        let object = object.unwrap_or_else(|| format!("a window of {}", room.name));
                        out.push(Conflict::InnerWindow { object, to: other.name.clone() });
                    }
                }
            }
        }
    }
    home.conflicts.extend(out);
}
