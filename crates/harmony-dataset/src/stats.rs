//! The paper's figure: room types and objects per scene, by level; here also objects by stage.
//! Key `data.figure`.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use serde::Serialize;

use crate::layout::Split;
use crate::records::Record;

/// Stages of placement in the order in which they are drawn.
const STAGES: [&str; 4] = ["furniture", "wall-mounted", "ceiling", "decoration"];
/// Colours of the splits, sRGB.
const COLORS: [&str; 3] = ["#3f8f5f", "#d99a2b", "#b4483a"];
/// Bins of the histogram of objects at most.
const BINS: usize = 12;

/// Counts of a data set.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Stats {
    /// Scenes by split.
    pub scenes: [usize; 3],
    /// Scenes by room type and split, most frequent first.
    pub rooms: Vec<(String, [usize; 3])>,
    /// Objects of each scene by split.
    pub objects: [Vec<usize>; 3],
    /// Objects by stage and split.
    pub stages: Vec<(String, [usize; 3])>,
    /// Objects by type, most frequent first.
    pub types: Vec<(String, usize)>,
}

impl Stats {
    /// Counts.
    pub fn of(records: &[Record]) -> Self {
        let mut scenes = [0; 3];
        let mut rooms: BTreeMap<String, [usize; 3]> = BTreeMap::new();
        let mut objects: [Vec<usize>; 3] = [Vec::new(), Vec::new(), Vec::new()];
        let mut stages: BTreeMap<&str, [usize; 3]> = STAGES.iter().map(|s| (*s, [0; 3])).collect();
        let mut types: BTreeMap<String, usize> = BTreeMap::new();
        for record in records {
            let k = Split::ALL.iter().position(|s| *s == record.id.split).unwrap_or(0);
            scenes[k] += 1;
            rooms.entry(record.id.room_type().replace('_', " ")).or_default()[k] += 1;
            objects[k].push(record.objects.len());
            for object in &record.objects {
                stages.entry(&object.stage).or_default()[k] += 1;
                *types.entry(object.kind.clone()).or_default() += 1;
            }
        }
        let mut rooms: Vec<(String, [usize; 3])> = rooms.into_iter().collect();
        rooms.sort_by(|a, b| b.1.iter().sum::<usize>().cmp(&a.1.iter().sum()).then(a.0.cmp(&b.0)));
        let mut types: Vec<(String, usize)> = types.into_iter().collect();
        types.sort_by(|a, b| b.1.cmp(&a.1).then(a.0.cmp(&b.0)));
        let mut rest: Vec<(String, [usize; 3])> =
            STAGES.iter().filter_map(|s| Some(((*s).to_owned(), stages.remove(s)?))).collect();
        rest.extend(stages.into_iter().map(|(s, n)| (s.to_owned(), n)));
        Self { scenes, rooms, objects, stages: rest, types }
    }

    /// Long table: figure, group, split, count.
    pub fn csv(&self) -> String {
        let mut out = "what,group,split,count\n".to_owned();
        let mut rows = |what: &str, groups: &[(String, [usize; 3])]| {
            for (group, counts) in groups {
                for (split, n) in Split::ALL.iter().zip(counts) {
                    let _ = writeln!(out, "{what},{},{},{n}", quoted(group), split.name());
                }
            }
        };
        rows("scenes", &[("all".to_owned(), self.scenes)]);
        rows("scenes_by_room_type", &self.rooms);
        let bins: Vec<(String, [usize; 3])> = self.histogram().into_iter().collect();
        rows("scenes_by_objects", &bins);
        rows("objects_by_stage", &self.stages);
        for (kind, n) in &self.types {
            let _ = writeln!(out, "objects_by_type,{},all,{n}", quoted(kind));
        }
        out
    }

    /// Scenes by number of objects, in bins of equal width.
    fn histogram(&self) -> Vec<(String, [usize; 3])> {
        let all = self.objects.iter().flatten();
        let (Some(low), Some(high)) = (all.clone().min(), all.max()) else { return Vec::new() };
        let width = (high - low + 1).div_ceil(BINS).max(1);
        let first = low / width * width;
        let bins = (high - first) / width + 1;
        (0..bins)
            .map(|b| {
                let (from, to) = (first + b * width, first + (b + 1) * width - 1);
                let name = if from == to { from.to_string() } else { format!("{from}-{to}") };
                let counts =
                    std::array::from_fn(|k| self.objects[k].iter().filter(|n| (from..=to).contains(n)).count());
                (name, counts)
            })
            .collect()
    }

    /// The figure.
    pub fn svg(&self) -> String {
        let rooms: Vec<(String, [usize; 3])> = if self.rooms.len() > 14 {
            let mut few = self.rooms[..13].to_vec();
            let rest = self.rooms[13..].iter().fold([0; 3], |sum, (_, n)| std::array::from_fn(|k| sum[k] + n[k]));
            few.push((format!("{} others", self.rooms.len() - 13), rest));
            few
        } else {
            self.rooms.clone()
        };
        let height = 330.0_f64.max(96.0 + 24.0 * rooms.len() as f64);
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 1200 {height}\" font-family=\"Helvetica,Arial,sans-serif\" \
             font-size=\"13\" fill=\"#1c2026\"><rect width=\"1200\" height=\"{height}\" fill=\"#ffffff\"/>"
        );
        let total: usize = self.scenes.iter().sum();
        let mut x = 20.0;
        for ((split, color), n) in Split::ALL.iter().zip(COLORS).zip(self.scenes) {
            let label = format!("{} ({n} scene{})", split.name(), if n == 1 { "" } else { "s" });
            let _ = write!(
                svg,
                "<rect x=\"{x}\" y=\"14\" width=\"14\" height=\"14\" fill=\"{color}\"/><text x=\"{}\" y=\"26\">{label}</text>",
                x + 20.0
            );
            x += 46.0 + 7.2 * label.len() as f64;
        }
        let mean = self.objects.iter().flatten().sum::<usize>() as f64 / total.max(1) as f64;
        lying(&mut svg, [20.0, 52.0, 380.0, height - 62.0], "Scenes by room type", &rooms);
        let head = format!("Scenes by number of objects (mean {mean:.1})");
        standing(&mut svg, [430.0, 52.0, 440.0, height - 62.0], &head, &self.histogram());
        standing(&mut svg, [900.0, 52.0, 280.0, height - 62.0], "Objects by stage", &self.stages);
        svg + "</svg>\n"
    }
}

fn quoted(text: &str) -> String {
    if text.contains([',', '"', '\n']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text.to_owned() }
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

fn head(svg: &mut String, x: f64, y: f64, text: &str) {
    let _ = write!(svg, "<text x=\"{x}\" y=\"{}\" font-weight=\"bold\">{}</text>", y + 12.0, escape(text));
}

fn largest(groups: &[(String, [usize; 3])]) -> f64 {
    groups.iter().map(|(_, n)| n.iter().sum::<usize>()).max().unwrap_or(1).max(1) as f64
}

/// Lying bars, one a group, splits stacked.
fn lying(svg: &mut String, [x, y, w, h]: [f64; 4], title: &str, groups: &[(String, [usize; 3])]) {
    head(svg, x, y, title);
    let most = largest(groups);
    let step = ((h - 26.0) / groups.len().max(1) as f64).min(28.0);
    let left = x + 130.0;
    for (i, (name, counts)) in groups.iter().enumerate() {
        let top = y + 24.0 + step * i as f64;
        let mid = top + step * 0.5 + 4.0;
        let _ = write!(svg, "<text x=\"{}\" y=\"{mid}\" text-anchor=\"end\">{}</text>", left - 6.0, escape(name));
        let mut at = left;
        for (n, color) in counts.iter().zip(COLORS) {
            let long = *n as f64 / most * (w - 170.0);
            if *n > 0 {
                let _ = write!(
                    svg,
                    "<rect x=\"{at:.1}\" y=\"{:.1}\" width=\"{long:.1}\" height=\"{:.1}\" fill=\"{color}\"/>",
                    top + step * 0.12,
                    step * 0.76
                );
            }
            at += long;
        }
        let _ = write!(svg, "<text x=\"{:.1}\" y=\"{mid}\">{}</text>", at + 6.0, counts.iter().sum::<usize>());
    }
}

/// Standing bars, one a group, splits stacked.
fn standing(svg: &mut String, [x, y, w, h]: [f64; 4], title: &str, groups: &[(String, [usize; 3])]) {
    head(svg, x, y, title);
    let most = largest(groups);
    let step = (w / groups.len().max(1) as f64).min(90.0);
    let (floor, high) = (y + h - 26.0, h - 66.0);
    let _ = write!(svg, "<line x1=\"{x}\" x2=\"{}\" y1=\"{floor}\" y2=\"{floor}\" stroke=\"#1c2026\"/>", x + w);
    for (i, (name, counts)) in groups.iter().enumerate() {
        let left = x + step * i as f64 + step * 0.12;
        let mid = x + step * (i as f64 + 0.5);
        let mut at = floor;
        for (n, color) in counts.iter().zip(COLORS).filter(|(n, _)| **n > 0) {
            let tall = *n as f64 / most * high;
            at -= tall;
            let _ = write!(
                svg,
                "<rect x=\"{left:.1}\" y=\"{at:.1}\" width=\"{:.1}\" height=\"{tall:.1}\" fill=\"{color}\"/>",
                step * 0.76
            );
        }
        let _ = write!(
            svg,
            "<text x=\"{mid:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text><text x=\"{mid:.1}\" y=\"{:.1}\" \
             text-anchor=\"middle\" font-size=\"{}\">{}</text>",
            at - 5.0,
            counts.iter().sum::<usize>(),
            floor + 17.0,
            if name.len() as f64 * 8.0 > step { 10.5 } else { 13.0 },
            escape(name)
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stats() -> Stats {
        Stats {
            scenes: [2, 3, 1],
            rooms: vec![("bed, room".into(), [1, 3, 0]), ("<study>".into(), [1, 0, 1])],
            objects: [vec![3, 40], vec![5, 5, 12], vec![77]],
            stages: vec![("furniture".into(), [4, 5, 6])],
            types: vec![("chair".into(), 9)],
        }
    }

    #[test]
    fn every_scene_is_in_one_bin() {
        let stats = stats();
        let bins = stats.histogram();
        assert!(bins.len() <= BINS + 1, "{bins:?}");
        let sums: [usize; 3] = std::array::from_fn(|k| bins.iter().map(|(_, n)| n[k]).sum());
        assert_eq!(sums, stats.scenes);
        // 3 to 77 are 75 numbers: bins of seven, from 0 on.
        assert_eq!(bins[0], ("0-6".to_owned(), [1, 2, 0]));
        assert_eq!(Stats { objects: [vec![], vec![], vec![]], ..stats }.histogram(), []);
    }

    #[test]
    fn the_figure_and_the_table_have_all_groups() {
        let svg = stats().svg();
        assert!(svg.contains("bed, room") && svg.contains("&lt;study&gt;") && !svg.contains("<study>"));
        assert!(svg.contains("easy (2 scenes)") && svg.contains("complicated (1 scene)"));
        // Mean of 3, 40, 5, 5, 12 and 77.
        assert!(svg.contains("mean 23.7"));
        let csv = stats().csv();
        assert!(csv.contains("scenes_by_room_type,\"bed, room\",medium,3\n"));
        assert!(
            csv.contains("objects_by_stage,furniture,complicated,6\n") && csv.contains("objects_by_type,chair,all,9\n")
        );
    }
}
