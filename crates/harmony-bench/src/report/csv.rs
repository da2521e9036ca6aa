//! Comma-separated tables.

use crate::run::BenchResult;
use crate::score::{LookScore, RoomScore, in_all};
use crate::summary::{Figure, summary};

/// A field as RFC 4180 wants it.
pub fn field(text: &str) -> String {
    if text.contains(['"', ',', '\n', '\r']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text.to_owned() }
}

/// Fields as a line.
pub fn line(fields: impl IntoIterator<Item = String>) -> String {
    let mut out = fields.into_iter().map(|f| field(&f)).collect::<Vec<_>>().join(",");
    out.push('\n');
    out
}

/// A number in full; empty when there is none.
pub fn number(value: f64) -> String {
    if value.is_finite() { format!("{value}") } else { String::new() }
}

fn optional(value: Option<f64>) -> String {
    value.map_or_else(String::new, number)
}

/// `table.csv`: a line a figure, raw and aligned.
pub fn figures(result: &BenchResult) -> String {
    let head = [
        "scale",
        "figure",
        "unit",
        "n",
        "value",
        "p25",
        "median",
        "p75",
        "p90",
        "worst",
        "mean",
        "target",
        "target_p90",
        "met",
    ];
    let mut out = line(head.map(str::to_owned));
    for (scale, rooms) in [("raw", &result.raw), ("aligned", &result.aligned)] {
        for f in summary(rooms) {
            out.push_str(&line(figure(scale, &f)));
        }
    }
    out
}

fn figure(scale: &str, f: &Figure) -> [String; 14] {
    let met = f.met().map_or("", |met| if met { "yes" } else { "no" });
    [
        scale.to_owned(),
        f.name.trim().to_owned(),
        f.unit.clone(),
        f.count.to_string(),
        number(f.value),
        optional(f.p25),
        optional(f.median),
        optional(f.p75),
        optional(f.p90),
        optional(f.worst),
        optional(f.mean),
        optional(f.target[0]),
        optional(f.target[1]),
        met.to_owned(),
    ]
}

/// `objects.csv`: a line an object, metres as delivered; objects that the run lacks have no id, those that are not
/// in the room no truth.
pub fn objects(rooms: &[RoomScore]) -> String {
    let head = [
        "room",
        "seed",
        "id",
        "truth",
        "level",
        "position_m",
        "dx_m",
        "dy_m",
        "dz_m",
        "yaw_deg",
        "has_front",
        "size_percent",
        "size_bias_percent",
        "iou",
        "support_right",
        "on_host_m",
        "confidence",
        "unseen",
    ];
    let mut out = line(head.map(str::to_owned));
    for r in rooms {
        let seed = r.seed.map_or_else(String::new, |s| s.to_string());
        for o in &r.objects {
            let matched = o.truth.is_some();
            let if_matched = |v: f64| if matched { number(v) } else { String::new() };
            out.push_str(&line([
                r.room.clone(),
                seed.clone(),
                o.id.clone(),
                o.truth.clone().unwrap_or_default(),
                format!("{:?}", o.level).to_lowercase(),
                if_matched(o.position_m),
                if_matched(o.offset[0]),
                if_matched(o.offset[1]),
                if_matched(o.offset[2]),
                if_matched(o.yaw_deg),
                o.has_front.to_string(),
                if_matched(100.0 * o.size),
                if_matched(100.0 * o.size_bias),
                if_matched(o.iou),
                o.support_right.to_string(),
                optional(o.on_host_m),
                number(o.confidence),
                if_matched(o.unseen),
            ]));
        }
        for missed in &r.missed {
            let mut fields = vec![String::new(); head.len()];
            (fields[0], fields[1], fields[3]) = (r.room.clone(), seed.clone(), missed.clone());
            out.push_str(&line(fields));
        }
    }
    out
}

/// `looks.csv`: a line a look of a run, and their sums; errors in the tolerances by which an object is right.
pub fn looks(rooms: &[RoomScore]) -> String {
    let head = [
        "room",
        "seed",
        "look",
        "questions",
        "faults",
        "found",
        "moved",
        "mended",
        "made_worse",
        "gained",
        "added_right",
        "added_wrong",
        "removed",
    ];
    let row = |room: &str, seed: String, s: &LookScore| {
        line([
            room.to_owned(),
            seed,
            s.look.about().to_owned(),
            s.questions.to_string(),
            s.there.to_string(),
            s.found.to_string(),
            s.moved.to_string(),
            s.mended.to_string(),
            s.made.to_string(),
            number(s.gained),
            s.added_right.to_string(),
            s.added_wrong.to_string(),
            s.removed.to_string(),
        ])
    };
    let mut out = line(head.map(str::to_owned));
    for r in rooms {
        let seed = r.seed.map_or_else(String::new, |s| s.to_string());
        for s in &r.looks {
            out.push_str(&row(&r.room, seed.clone(), s));
        }
    }
    for s in in_all(rooms.iter().flat_map(|r| &r.looks)) {
        out.push_str(&row("all", String::new(), &s));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_with_commas_and_quotes_are_quoted() {
        let fields = ["position, decorations", "a \"b\"", "plain", ""].map(str::to_owned);
        assert_eq!(line(fields), "\"position, decorations\",\"a \"\"b\"\"\",plain,\n");
        assert_eq!((number(f64::NAN), number(0.25)), (String::new(), "0.25".to_owned()));
    }
}
