//! Cleaning of masks by their connected components.

use harmony_scene::components;

/// Removes set components below `least` pixels (the largest always stays) and fills unset ones below `hole` pixels
/// that do not touch the border.
pub(crate) fn clean(set: &mut [bool], width: usize, height: usize, least: usize, hole: usize) {
    let (labels, counts) = components(set, width, height);
    let largest = counts.iter().copied().max().unwrap_or(0);
    for (on, id) in set.iter_mut().zip(&labels) {
        let n = counts[*id as usize];
        *on = *on && (n >= least || n == largest);
    }
    let unset: Vec<bool> = set.iter().map(|b| !b).collect();
    let (labels, counts) = components(&unset, width, height);
    let mut open = vec![false; counts.len()];
    for (i, id) in labels.iter().enumerate() {
        let (x, y) = (i % width, i / width);
        if x == 0 || y == 0 || x + 1 == width || y + 1 == height {
            open[*id as usize] = true;
        }
    }
    for (on, id) in set.iter_mut().zip(&labels) {
        if *id > 0 && !open[*id as usize] && counts[*id as usize] < hole {
            *on = true;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn islands_go_and_holes_close() {
        let art = ["..........", ".#####..#.", ".#...#....", ".#.#.#..##", ".#####..##"];
        let mut set: Vec<bool> = art.iter().flat_map(|r| r.bytes().map(|b| b == b'#')).collect();
        clean(&mut set, 10, 5, 3, 10);
        assert_eq!(set.iter().filter(|b| **b).count(), 20 + 4);
        assert!(!set[18]);
    }
}
