//! Connected components.

/// Labels 4-connected components of the set pixels: 0 = not set, then 1, 2, ... in reading order of their first pixel,
/// and the pixel count of each (index 0 unused).
pub(crate) fn label(set: &[bool], width: usize, height: usize) -> (Vec<u32>, Vec<usize>) {
    let mut labels = vec![0_u32; width * height];
    let mut counts = vec![0_usize];
    let mut stack = Vec::new();
    for start in 0..set.len().min(labels.len()) {
        if !set[start] || labels[start] != 0 {
            continue;
        }
        let id = counts.len() as u32;
        counts.push(0);
        labels[start] = id;
        stack.push(start);
        while let Some(i) = stack.pop() {
            counts[id as usize] += 1;
            let (x, y) = (i % width, i / width);
            let mut visit = |j: usize| {
                if set[j] && labels[j] == 0 {
                    labels[j] = id;
                    stack.push(j);
                }
            };
            if x > 0 {
                visit(i - 1);
            }
            if x + 1 < width {
                visit(i + 1);
            }
            if y > 0 {
                visit(i - width);
            }
            if y + 1 < height {
                visit(i + width);
            }
        }
    }
    (labels, counts)
}

/// Removes set components below `least` pixels (the largest always stays) and fills unset ones below `hole` pixels
/// that do not touch the border.
pub(crate) fn clean(set: &mut [bool], width: usize, height: usize, least: usize, hole: usize) {
    let (labels, counts) = label(set, width, height);
    let largest = counts.iter().copied().max().unwrap_or(0);
    for (on, id) in set.iter_mut().zip(&labels) {
        let n = counts[*id as usize];
        *on = *on && (n >= least || n == largest);
    }
    let unset: Vec<bool> = set.iter().map(|b| !b).collect();
    let (labels, counts) = label(&unset, width, height);
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
        let (_, counts) = label(&set, 10, 5);
        assert_eq!(counts[1..], [15, 1, 4]);
        clean(&mut set, 10, 5, 3, 10);
        assert_eq!(set.iter().filter(|b| **b).count(), 20 + 4);
        assert!(!set[18]);
    }
}
