//! `judge.html`: the scores, then every scene with its pictures and what was said.

use std::fmt::Write;

use super::pictures::JudgeScene;
use super::play::{Judgement, Trial};
use super::question::Better;
use crate::page::{embedded, esc, page as around};

/// The page.
pub fn page(j: &Judgement, scenes: &[JudgeScene]) -> String {
    let mut html = format!(
        "<h1>Judged by looking</h1><p>{}; {} renders; judge: {}; {} questions, every pair in both orders</p>",
        esc(&j.sets.join(", ")),
        j.look.name(),
        esc(&j.judge),
        j.trials.len()
    );
    html.push_str("<div class=\"wide\"><table><tr><th>criterion");
    for set in &j.sets {
        let _ = write!(html, "<th>{} won<th>strength<th>95 %", esc(set));
    }
    html.push_str("<th>orders agree<th>no answer</tr>");
    for score in &j.scores {
        let _ = write!(html, "<tr><td>{}", score.criterion.title());
        for s in &score.strengths {
            let sure = s.interval.map_or_else(|| "-".to_owned(), |i| format!("{:+.2} .. {:+.2}", i.low, i.high));
            let _ = write!(html, "<td>{:.1} of {}<td>{:+.2}<td>{sure}", s.won, s.of, s.log);
        }
        let same = score.consistent.map_or_else(|| "-".to_owned(), |c| format!("{:.0} %", 100.0 * c));
        let _ = write!(html, "<td>{same}<td>{}</tr>", score.missing);
    }
    html.push_str(
        "</table></div><p class=\"soft\">won: pairs in which both orders agree, ties as halves. strength: \
         Bradley-Terry, logarithmic, mean 0; a lead of 1.1 is winning three times of four. 95 %: bootstrap over scenes.</p>",
    );
    for scene in scenes {
        let _ = write!(html, "<h3>{}</h3><div class=\"row\">", esc(&scene.scene));
        match scene.load() {
            Ok((photo, views)) => {
                let _ = write!(html, "<figure>{}<figcaption>photo</figcaption></figure>", embedded(&photo, "photo"));
                for view in &views {
                    for (set, image) in [(scene.pair.first, &view.first), (scene.pair.second, &view.second)] {
                        let name = format!("{}, {}", j.sets[set], view.name);
                        let _ = write!(
                            html,
                            "<figure>{}<figcaption>{}</figcaption></figure>",
                            embedded(image, &name),
                            esc(&name)
                        );
                    }
                }
            }
            Err(reason) => {
                let _ = write!(html, "<p class=\"bad\">{}</p>", esc(&reason));
            }
        }
        html.push_str("</div>");
        for trial in j.trials.iter().filter(|t| t.scene == scene.scene && t.pair == scene.pair) {
            said(&mut html, j, trial);
        }
    }
    around("HARMONY: judged by looking", &html)
}

fn said(html: &mut String, j: &Judgement, trial: &Trial) {
    let (a, b) =
        if trial.swapped { (trial.pair.second, trial.pair.first) } else { (trial.pair.first, trial.pair.second) };
    let letters = format!("A is {}, B is {}", j.sets[a], j.sets[b]);
    let Some(verdicts) = &trial.verdicts else {
        let error = trial.error.as_deref().unwrap_or("no answer");
        let _ = write!(html, "<p><small>{}</small> <span class=\"bad\">{}</span></p>", esc(&letters), esc(error));
        return;
    };
    let name = |better: &Better| match better {
        Better::A => j.sets[a].as_str(),
        Better::B => j.sets[b].as_str(),
        Better::Same => "same",
    };
    let each: Vec<String> = verdicts.iter().map(|(c, v)| format!("{}: {}", c.title(), name(v))).collect();
    let _ = write!(
        html,
        "<p><small>{}. {}</small><br>{}</p>",
        esc(&letters),
        esc(&each.join("; ")),
        esc(&trial.observations)
    );
}
