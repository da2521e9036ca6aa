//! `harmony.toml` as setup leaves it: a new one with comments, or what is there with nothing changed but what has to be.

use anyhow::{Context, Result};
use harmony_calls::Price;
use serde::Serialize;
use toml_edit::{DocumentMut, Item, Table, value};

use super::propose::{Choice, Proposal};
use crate::config::{self, Profile};

/// Prices that were read, with what they are of; `docs/players.md` says where. A service that takes credits, or seconds
/// of a machine, has no price for a piece.
const PRICES: [(&str, Price, &str); 5] = [
    ("gpt-5.5", tokens(5.0, 0.5, 30.0), "a million tokens: input, of it cached, output"),
    ("gemini-3.1-flash-image", image(0.067), "an image of about a megapixel"),
    ("gpt-image-1.5", image(0.034), "an image, quality medium"),
    ("fal-ai/trellis", mesh(0.02), "a mesh"),
    ("fal-ai/hunyuan3d/v2", mesh(0.48), "a textured mesh: three times 0.16"),
];

/// When they were read.
const PRICES_READ: &str = "2026-11-25";

const fn nothing() -> Price {
    Price { input: 0.0, cached: None, output: 0.0, image: 0.0, mesh: 0.0, call: 0.0 }
}

const fn tokens(input: f64, cached: f64, output: f64) -> Price {
    Price { input, cached: Some(cached), output, ..nothing() }
}

const fn image(image: f64) -> Price {
    Price { image, ..nothing() }
}

const fn mesh(mesh: f64) -> Price {
    Price { mesh, ..nothing() }
}

/// A file's new text, and what is different from before.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Written {
    /// The whole text.
    pub text: String,
    /// Each change in a line; none = the text is what was there.
    pub changes: Vec<String>,
}

/// What is said over a new section.
struct Section<'a> {
    name: &'a str,
    comment: String,
}

/// Puts a proposal into a file. `before` is what is there; `None` = nothing.
///
/// # Errors
/// What is there is not TOML, or has something else where a section belongs.
pub fn written(before: Option<&str>, proposal: &Proposal) -> Result<Written> {
    let mut doc: DocumentMut = before.unwrap_or_default().parse().context("reading harmony.toml")?;
    let mut changes = Vec::new();
    if before.is_none() {
        let head = "# Written by `harmony setup`. Change what you like: running it again leaves it as it is.\n\
                    # `harmony schema config` prints all that can be set, docs/players.md tells of the players.\n\
                    # Keys stand in the environment, never here.\n\n";
        doc.decor_mut().set_prefix(head);
    }
    set(doc.as_table_mut(), "profile", proposal.profile.name(), "profile", &mut changes);
    // `offline` and `files` take no service from the file.
    if !matches!(proposal.profile, Profile::Offline | Profile::Files) {
        role(&mut doc, "vision_language", "Who looks", &proposal.language, &mut changes)?;
        role(&mut doc, "image_editor", "Who draws", &proposal.editor, &mut changes)?;
        role(&mut doc, "mesh_generator", "Who makes meshes", &proposal.meshes, &mut changes)?;
        boxes(&mut doc, proposal, &mut changes)?;
    }
    let text = doc.to_string();
    let file =
        config::parse(&text).map_err(|reason| anyhow::anyhow!("what setup would write does not fit: {reason}"))?;
    let text = with_prices(doc, &file, proposal.profile, &mut changes)?.to_string();
    config::parse(&text).map_err(|reason| anyhow::anyhow!("what setup would write does not fit: {reason}"))?;
    Ok(Written { text, changes })
}

/// Sets a text where it is another one.
fn set(table: &mut Table, key: &str, text: &str, told: &str, changes: &mut Vec<String>) {
    let before = table.get(key).and_then(Item::as_str).map(str::to_owned);
    if before.as_deref() == Some(text) {
        return;
    }
    changes.push(match before {
        Some(before) => format!("{told}: {before:?} -> {text:?}"),
        None => format!("{told} = {text:?}"),
    });
    match table.get_mut(key) {
        // Comments around the value stay.
        Some(Item::Value(old)) => {
            let decor = old.decor().clone();
            *old = text.into();
            *old.decor_mut() = decor;
        }
        _ => {
            table.insert(key, value(text));
        }
    }
}

/// Takes a value out.
fn unset(table: &mut Table, key: &str, told: &str, changes: &mut Vec<String>) {
    if let Some(before) = table.remove(key) {
        changes.push(format!("{told}: {} taken out", before.to_string().trim()));
    }
}

/// A section below another, made when it is not there.
fn section<'t>(parent: &'t mut Table, section: &Section<'_>) -> Result<&'t mut Table> {
    if !parent.contains_key(section.name) {
        let mut table = Table::new();
        if section.comment.is_empty() {
            table.set_implicit(true);
        } else {
            table.decor_mut().set_prefix(format!("\n# {}\n", section.comment.replace('\n', "\n# ")));
        }
        parent.insert(section.name, Item::Table(table));
    }
    let name = section.name;
    parent[name]
        .as_table_mut()
        .with_context(|| format!("{name} in harmony.toml is written in one line; write [{name}]"))
}

fn players<'t>(doc: &'t mut DocumentMut, name: &str, comment: String) -> Result<&'t mut Table> {
    let all = section(doc.as_table_mut(), &Section { name: "players", comment: String::new() })?;
    section(all, &Section { name, comment })
}

/// The name of a player as the file has it.
fn name_of<P: Serialize>(player: &P) -> Result<String> {
    let name = serde_json::to_value(player)?;
    Ok(name.as_str().context("a player has a name")?.to_owned())
}

fn role<P: Serialize>(
    doc: &mut DocumentMut,
    name: &str,
    what: &str,
    choice: &Choice<P>,
    changes: &mut Vec<String>,
) -> Result<()> {
    let player = name_of(&choice.player)?;
    let missing = choice.missing.as_ref().map_or_else(String::new, |missing| format!("\nMissing: {missing}"));
    let comment = format!("{what}: {}.{missing}", choice.why);
    let table = players(doc, name, comment)?;
    // A section without a player is about the one that is proposed now.
    let other = table.get("player").and_then(Item::as_str).is_some_and(|before| before != player);
    set(table, "player", &player, &format!("players.{name}.player"), changes);
    match &choice.address {
        Some(address) if other || !table.contains_key("address") => {
            set(table, "address", address, &format!("players.{name}.address"), changes);
        }
        // Another player is elsewhere, and has other models and another key.
        None if other => unset(table, "address", &format!("players.{name}.address"), changes),
        _ => {}
    }
    if other {
        unset(table, "key_env", &format!("players.{name}.key_env"), changes);
    }
    match &choice.model {
        Some(model) if other || !table.contains_key("model") => {
            set(table, "model", model, &format!("players.{name}.model"), changes);
        }
        None if other => unset(table, "model", &format!("players.{name}.model"), changes),
        _ => {}
    }
    Ok(())
}

fn boxes(doc: &mut DocumentMut, proposal: &Proposal, changes: &mut Vec<String>) -> Result<()> {
    let there = doc.get("players").and_then(|players| players.get("detector")).is_some();
    // A detector that the user set up stays.
    if there {
        return Ok(());
    }
    let comment = "Who gives boxes; with `native = true` OWLv2 inside this program, where its weights are.";
    let table = players(doc, "detector", comment.to_owned())?;
    set(table, "player", &name_of(&proposal.boxes)?, "players.detector.player", changes);
    table.insert("native", value(true));
    Ok(())
}

/// With prices of the models that play and have none yet.
fn with_prices(
    mut doc: DocumentMut,
    file: &config::ConfigFile,
    profile: Profile,
    changes: &mut Vec<String>,
) -> Result<DocumentMut> {
    let players = file.players.resolved(profile);
    let models = [players.vision_language.model, players.image_editor.model, players.mesh_generator.model];
    let known = |model: &str| file.prices.models.keys().any(|name| model.starts_with(name.as_str()));
    let wanted: Vec<_> = PRICES
        .iter()
        .filter(|(name, ..)| models.iter().flatten().any(|model| model == name && !known(model)))
        .collect();
    if wanted.is_empty() {
        return Ok(doc);
    }
    let comment = "US dollars, as they were read on public pages; look at the makers' own. What has no price here is told\n\
                   as \"no known cost\": Gemini's language models, Replicate (seconds), Tripo and Meshy (credits).";
    let prices = section(doc.as_table_mut(), &Section { name: "prices", comment: comment.to_owned() })?;
    if !prices.contains_key("date") {
        prices.insert("date", value(PRICES_READ));
    }
    for (name, price, what) in wanted {
        let models = section(prices, &Section { name: "models", comment: String::new() })?;
        let mut table = Table::new();
        table.decor_mut().set_prefix(format!("# {what}\n"));
        for (key, amount) in [
            ("input", Some(price.input)),
            ("cached", price.cached),
            ("output", Some(price.output)),
            ("image", Some(price.image)),
            ("mesh", Some(price.mesh)),
        ] {
            if let Some(amount) = amount.filter(|amount| *amount > 0.0) {
                table.insert(key, value(amount));
            }
        }
        models.insert(name, Item::Table(table));
        changes.push(format!("prices.models.{name:?} as of {PRICES_READ}"));
    }
    Ok(doc)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::players::{Editor, Language, Meshes};
    use crate::setup::propose::tests::machine;
    use crate::setup::propose::{Wish, propose};
    use crate::survey::ServerKind;

    fn hosted() -> Proposal {
        propose(&machine(&["GEMINI_API_KEY", "FAL_KEY"], &[]), Wish::default())
    }

    #[test]
    fn a_new_file_has_comments_plays_what_is_proposed_and_is_not_written_twice() {
        let first = written(None, &hosted()).unwrap();
        let file = config::parse(&first.text).unwrap();
        assert_eq!(file.profile, Some(Profile::Hosted));
        let players = file.players.resolved(Profile::Hosted);
        assert_eq!(
            (players.vision_language.player, players.image_editor.player, players.mesh_generator.player),
            (Some(Language::Gemini), Some(Editor::Gemini), Some(Meshes::Fal))
        );
        let priced = |model: &str| file.prices.models.contains_key(model);
        assert!(priced("fal-ai/trellis") && priced("gemini-3.1-flash-image"));
        assert!(first.text.contains("# Who makes meshes: FAL_KEY is set."), "{}", first.text);
        let second = written(Some(&first.text), &hosted()).unwrap();
        assert_eq!((second.text, second.changes), (first.text, vec![]));
    }

    #[test]
    fn what_the_user_wrote_stays_and_only_what_changed_is_changed() {
        let mine = "# mine\nprofile = \"hosted\" # keep this\n\n[budget]\nusd = 2.0\n\n[players.vision_language]\n\
                    player = \"gemini\"\nmodel = \"gemini-of-mine\" # and this\n\n[prices.models.\"fal-ai/trellis\"]\nmesh = 0.5\n";
        let other = propose(
            &machine(&["GEMINI_API_KEY", "MESHY_API_KEY"], &[]),
            Wish { meshes: Some(Meshes::Meshy), ..Wish::default() },
        );
        let new = written(Some(mine), &other).unwrap();
        for kept in ["# mine", "# keep this", "usd = 2.0", "gemini-of-mine\" # and this", "mesh = 0.5"] {
            assert!(new.text.contains(kept), "{kept}: {}", new.text);
        }
        let file = config::parse(&new.text).unwrap();
        assert_eq!(file.players.mesh_generator.player, Some(Meshes::Meshy));
        assert!((file.prices.models["fal-ai/trellis"].mesh - 0.5).abs() < 1e-9, "the user's price stays");
        assert!(new.changes.iter().any(|change| change.contains("mesh_generator.player")), "{:?}", new.changes);
        assert!(!new.changes.iter().any(|change| change.contains("vision_language")), "{:?}", new.changes);
    }

    #[test]
    fn another_player_does_not_keep_the_address_of_the_one_before() {
        let servers: [(ServerKind, &str, &[&str]); 1] = [(ServerKind::Vllm, "http://127.0.0.1:8000/v1", &["a", "b"])];
        let local = written(None, &propose(&machine(&[], &servers), Wish::default())).unwrap();
        assert!(local.text.contains("address = \"http://127.0.0.1:8000/v1\"") && local.text.contains("model = \"a\""));
        let hosted = written(Some(&local.text), &hosted()).unwrap();
        let language = config::parse(&hosted.text).unwrap().players.vision_language;
        assert_eq!((language.player, language.address, language.model), (Some(Language::Gemini), None, None));
    }

    #[test]
    fn this_program_alone_needs_a_line_and_broken_files_are_not_touched() {
        let alone = written(None, &propose(&machine(&[], &[]), Wish::default())).unwrap();
        assert!(alone.text.contains("profile = \"offline\"") && !alone.text.contains("[players"), "{}", alone.text);
        assert!(written(Some("profile = "), &hosted()).is_err());
        assert!(written(Some("players = 3\n"), &hosted()).is_err());
    }
}
