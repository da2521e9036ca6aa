//! Connected components.

/// Labels 4-connected components of the set pixels: 0 = not set, then 1, 2, ... in reading order of their first pixel,
/// and the pixel count of each (index 0 unused).
pub fn components(set: &[bool], width: usize, height: usize) -> (Vec<u32>, Vec<usize>) {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sides_connect_and_corners_do_not() {
        let art = ["......#...", ".#####..#.", ".#...#....", ".#.#.#..##", ".#####..##"];
        let set: Vec<bool> = art.iter().flat_map(|r| r.bytes().map(|b| b == b'#')).collect();
        let (labels, counts) = components(&set, 10, 5);
        assert_eq!(counts[1..], [1, 15, 1, 4]);
        assert_eq!([0, 6, 11, 18, 33, 38].map(|i: usize| labels[i]), [0, 1, 2, 3, 2, 4]);
    }
}
