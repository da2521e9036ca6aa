//! Tiles that were baked lately.
//!
//! A program is built several times in a run: when its answer is checked, when its object is made, after a second look. Its
//! patterns seldom change, and drawing them costs more than all else in it. A tile depends on nothing but colour, pattern,
//! relief and roughness, so that one that was drawn before is the same one; members of a set share it in memory, too.

use std::collections::VecDeque;
use std::sync::{Arc, LazyLock, Mutex, PoisonError};

use harmony_mesh::Tile;

use super::MaterialSpec;
use super::bake::bake_tile;

/// Bytes of tiles that are kept; the oldest go first.
const MAX_BYTES: usize = 192 << 20;

/// Slots, each without what is not drawn, and their tiles; the oldest first.
type Tiles = VecDeque<(MaterialSpec, Arc<Tile>)>;

static KEPT: LazyLock<Mutex<Tiles>> = LazyLock::new(Mutex::default);

/// The tile of a slot with a pattern, at the texel that its scale asks for.
pub(super) fn tile(spec: &MaterialSpec) -> Arc<Tile> {
    let key = drawn(spec);
    // Whoever panicked while it held the lock left whole entries behind.
    let lock = || KEPT.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some((_, tile)) = lock().iter().find(|(kept, _)| *kept == key) {
        return Arc::clone(tile);
    }
    let tile = Arc::new(bake_tile(spec, None));
    let mut kept = lock();
    kept.push_back((key, Arc::clone(&tile)));
    while kept.iter().map(|(_, tile)| bytes(tile)).sum::<usize>() > MAX_BYTES && kept.len() > 1 {
        kept.pop_front();
    }
    tile
}

/// What of a slot is drawn into its tile.
fn drawn(spec: &MaterialSpec) -> MaterialSpec {
    MaterialSpec { map: spec.map.clone(), bump: spec.bump, rough: spec.rough, ..MaterialSpec::plain("", &spec.color) }
}

fn bytes(tile: &Tile) -> usize {
    let images = [tile.normal.as_ref(), tile.surface.as_ref()];
    tile.color.len() + images.into_iter().flatten().map(|image| image.len()).sum::<usize>()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::material::{Pattern, PatternKind};

    #[test]
    fn a_pattern_is_drawn_once_whatever_its_slot_is_called() {
        let oak = |name: &str, rough: f64| MaterialSpec {
            map: Some(Pattern { width: 0.07, ..Pattern::new(PatternKind::Planks) }),
            rough,
            ..MaterialSpec::plain(name, "#8a6a44")
        };
        let first = tile(&oak("top", 0.5));
        assert!(Arc::ptr_eq(&first, &tile(&oak("legs", 0.5))));
        let other = tile(&oak("top", 0.4));
        assert!(!Arc::ptr_eq(&first, &other));
        let fresh = bake_tile(&oak("top", 0.5), None);
        assert_eq!(*first.color, *fresh.color);
        assert_ne!(first.surface, other.surface, "roughness is in it");
    }
}
