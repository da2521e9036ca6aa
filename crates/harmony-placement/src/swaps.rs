//! Colours of a matched set on the right sides. Paper App. C "Matched-group reordering".

/// Which members of a matched set should exchange their looks so that colours stand where the photo shows them.
///
/// `wanted` are the mean colours under the masks, `shown` those of the rendered objects, in one order. Returns
/// index pairs to swap one after the other; each one lowers the summed colour distance by more than `margin`.
pub fn color_swaps(wanted: &[[f32; 3]], shown: &[[f32; 3]], margin: f32) -> Vec<(usize, usize)> {
    let n = wanted.len().min(shown.len());
    let distance = |a: &[f32; 3], b: &[f32; 3]| a.iter().zip(b).map(|(x, y)| (x - y) * (x - y)).sum::<f32>().sqrt();
    let mut shown: Vec<[f32; 3]> = shown[..n].to_vec();
    let mut out = Vec::new();
    for _ in 0..n {
        let mut best: Option<(f32, usize, usize)> = None;
        for i in 0..n {
            for j in i + 1..n {
                let now = distance(&wanted[i], &shown[i]) + distance(&wanted[j], &shown[j]);
                let then = distance(&wanted[i], &shown[j]) + distance(&wanted[j], &shown[i]);
                let gain = now - then;
                if gain > margin && best.is_none_or(|(g, _, _)| gain > g) {
                    best = Some((gain, i, j));
                }
            }
        }
        let Some((_, i, j)) = best else { break };
        shown.swap(i, j);
        out.push((i, j));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_and_dark_chairs_go_back_to_their_sides() {
        let (light, dark) = ([0.8_f32; 3], [0.1_f32; 3]);
        assert_eq!(color_swaps(&[light, dark], &[dark, light], 0.05), vec![(0, 1)]);
        assert!(color_swaps(&[light, dark], &[light, dark], 0.05).is_empty());
        assert!(color_swaps(&[light, light], &[light, [0.79; 3]], 0.05).is_empty());
        let three = [[0.9, 0.0, 0.0], [0.0, 0.9, 0.0], [0.0, 0.0, 0.9]];
        let mut turned = three;
        turned.rotate_left(1);
        for (i, j) in color_swaps(&three, &turned, 0.05) {
            turned.swap(i, j);
        }
        assert_eq!(turned, three);
    }
}
