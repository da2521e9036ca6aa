//! Our own letters: strokes on a grid, drawn for this program.

use glam::DVec2;

/// One stroke.
pub(crate) struct Stroke {
    /// Points on the grid.
    pub points: Vec<DVec2>,
    /// Whether its corners are rounded.
    pub round: bool,
}

/// Strokes by letter: `~` before a round one, points as two digits (x, y + 3), spaces between, `/` between strokes.
///
/// y: 0 is the lowest descender, 3 the baseline, 8 the height of small letters, 11 (`b`) the height of capitals.
const GLYPHS: &[(char, f64, &str)] = &[
    ('A', 6.0, "03 3b 63/15 55"),
    ('B', 5.0, "03 0b/~0b 3b 5b 57 37 07/07 37/~07 37 57 53 33 03"),
    ('C', 5.0, "~59 5b 0b 03 53 55"),
    ('D', 5.0, "03 0b/~0b 3b 5b 53 33 03"),
    ('E', 5.0, "5b 0b 03 53/07 47"),
    ('F', 5.0, "5b 0b 03/07 47"),
    ('G', 5.0, "~59 5b 0b 03 53 57/57 37"),
    ('H', 5.0, "03 0b/53 5b/07 57"),
    ('I', 0.0, "03 0b"),
    ('J', 4.0, "~4b 43 03 05"),
    ('K', 5.0, "03 0b/5b 06 53"),
    ('L', 4.0, "0b 03 43"),
    ('M', 6.0, "03 0b 35 6b 63"),
    ('N', 5.0, "03 0b 53 5b"),
    ('O', 6.0, "~3b 0b 03 63 6b 3b"),
    ('P', 5.0, "03 0b/~0b 5b 57 06"),
    ('Q', 6.0, "~3b 0b 03 63 6b 3b/45 62"),
    ('R', 5.0, "03 0b/~0b 5b 57 06/36 53"),
    ('S', 5.0, "~59 5b 0b 07 57 53 03 05"),
    ('T', 6.0, "0b 6b/3b 33"),
    ('U', 5.0, "~0b 03 53 5b"),
    ('V', 6.0, "0b 33 6b"),
    ('W', 6.0, "0b 13 39 53 6b"),
    ('X', 5.0, "03 5b/0b 53"),
    ('Y', 6.0, "0b 37 6b/37 33"),
    ('Z', 5.0, "0b 5b 03 53"),
    ('a', 4.0, "~48 08 03 43/48 43"),
    ('b', 4.0, "0b 03/~08 48 43 03"),
    ('c', 4.0, "~47 48 08 03 43 44"),
    ('d', 4.0, "4b 43/~48 08 03 43"),
    ('e', 4.0, "05 45/~45 48 08 03 43 44"),
    ('f', 3.0, "~3b 1b 13/08 38"),
    ('g', 4.0, "~48 40 00 01/~48 08 03 43"),
    ('h', 4.0, "0b 03/~06 08 48 43"),
    ('i', 0.0, "03 08/0a 0b"),
    ('j', 2.0, "~28 20 00/2a 2b"),
    ('k', 4.0, "0b 03/48 05 43"),
    ('l', 1.0, "~0b 03 13"),
    ('m', 6.0, "03 08/~06 08 38 33/~36 38 68 63"),
    ('n', 4.0, "03 08/~06 08 48 43"),
    ('o', 4.0, "~28 08 03 43 48 28"),
    ('p', 4.0, "08 00/~08 48 43 03"),
    ('q', 4.0, "48 40/~48 08 03 43"),
    ('r', 3.0, "03 08/~06 08 38"),
    ('s', 4.0, "~47 48 08 06 45 43 03 04"),
    ('t', 3.0, "~1b 13 33/08 38"),
    ('u', 4.0, "~08 03 43 45/48 43"),
    ('v', 4.0, "08 23 48"),
    ('w', 6.0, "08 13 37 53 68"),
    ('x', 4.0, "08 43/03 48"),
    ('y', 4.0, "08 23/48 10"),
    ('z', 4.0, "08 48 03 43"),
    ('0', 5.0, "~2b 0b 03 53 5b 2b"),
    ('1', 2.0, "09 2b 23"),
    ('2', 5.0, "~09 0b 5b 57 03/03 53"),
    ('3', 5.0, "~09 0b 5b 57 27/~27 57 53 03 05"),
    ('4', 5.0, "43 4b 05 55"),
    ('5', 5.0, "5b 0b 07/~07 57 53 03 04"),
    ('6', 5.0, "~5a 5b 0b 03 53 57 07 05"),
    ('7', 5.0, "0b 5b 23"),
    ('8', 5.0, "~27 07 0b 5b 57 27/~27 07 03 53 57 27"),
    ('9', 5.0, "~04 03 53 5b 0b 07 57 59"),
    ('.', 0.0, "03 03"),
    (',', 1.0, "13 02"),
    (':', 0.0, "03 03/07 07"),
    (';', 1.0, "13 02/17 17"),
    ('!', 0.0, "0b 06/03 03"),
    ('?', 4.0, "~09 0b 4b 47 26/26 25/23 23"),
    ('\'', 0.0, "0b 09"),
    ('"', 2.0, "0b 09/2b 29"),
    ('-', 3.0, "06 36"),
    ('_', 4.0, "02 42"),
    ('+', 4.0, "06 46/24 28"),
    ('=', 4.0, "05 45/07 47"),
    ('*', 4.0, "24 28/05 47/07 45"),
    ('/', 4.0, "03 4b"),
    ('(', 2.0, "~2b 09 05 22"),
    (')', 2.0, "~0b 29 25 02"),
    ('&', 6.0, "~63 07 1b 4b 47 05 03 43 66"),
    ('%', 6.0, "03 6b/~1b 0b 09 29 2b 1b/~53 43 45 65 63 53"),
    ('#', 5.0, "13 1b/43 4b/05 55/09 59"),
    ('@', 6.0, "~56 36 38 58 55 66 6b 0b 03 53"),
    ('$', 5.0, "~59 5b 0b 07 57 53 03 05/22 2b"),
    ('€', 5.0, "~59 5b 1b 13 53 55/06 36/08 38"),
    ('•', 1.0, "16 17"),
    ('°', 2.0, "~1b 0b 09 29 2b 1b"),
    ('♥', 6.0, "~37 3b 6b 68 33/~37 3b 0b 08 33"),
];

/// Letters that are drawn as others.
const PLAIN: &[(&str, char)] = &[
    ("ÀÁÂÃÄÅ", 'A'),
    ("ÈÉÊË", 'E'),
    ("ÌÍÎÏ", 'I'),
    ("ÒÓÔÕÖØ", 'O'),
    ("ÙÚÛÜ", 'U'),
    ("Ç", 'C'),
    ("Ñ", 'N'),
    ("àáâãäå", 'a'),
    ("èéêë", 'e'),
    ("ìíîï", 'i'),
    ("òóôõöø", 'o'),
    ("ùúûü", 'u'),
    ("ç", 'c'),
    ("ñ", 'n'),
    ("ß", 's'),
    ("‘’`´", '\''),
    ("“”„", '"'),
    ("–—", '-'),
];

/// Width (without the space after it) and strokes of a letter.
pub(crate) fn glyph(c: char) -> (f64, Vec<Stroke>) {
    if c.is_whitespace() {
        return (2.2, Vec::new());
    }
    let c = PLAIN.iter().find(|(all, _)| all.contains(c)).map_or(c, |(_, plain)| *plain);
    let (width, strokes) = GLYPHS.iter().find(|g| g.0 == c).map_or((4.0, "03 0b 4b 43 03"), |g| (g.1, g.2));
    let strokes = strokes
        .split('/')
        .map(|stroke| {
            let (round, points) = stroke.strip_prefix('~').map_or((false, stroke), |rest| (true, rest));
            let points = points
                .split(' ')
                .filter_map(|p| {
                    let mut digits = p.chars().filter_map(|d| d.to_digit(16)).map(f64::from);
                    Some(DVec2::new(digits.next()?, digits.next()? - 3.0))
                })
                .collect();
            Stroke { points, round }
        })
        .collect();
    (width, strokes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_letter_lies_within_its_width_and_height() {
        for (c, width, _) in GLYPHS {
            let (w, strokes) = glyph(*c);
            assert_eq!(w, *width);
            assert!(!strokes.is_empty());
            for p in strokes.iter().flat_map(|s| &s.points) {
                assert!(p.x >= 0.0 && p.x <= *width && p.y >= -3.0 && p.y <= 8.0, "{c} {p}");
            }
            assert!(strokes.iter().all(|s| s.points.len() >= 2), "{c}");
        }
    }
}
