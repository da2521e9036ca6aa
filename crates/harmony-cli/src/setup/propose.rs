//! Who should play on this machine.
//!
//! What runs here and costs nothing comes before what costs; of what costs, the cheaper one whose price was read. What the
//! user wishes comes before everything.

use crate::config::Profile;
use crate::config::players::{Boxes, Editor, Language, Meshes};
use crate::survey::{ServerKind, Survey};

/// What the user wishes; `None` = what is proposed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Wish {
    /// Who looks.
    pub language: Option<Language>,
    /// Who draws.
    pub editor: Option<Editor>,
    /// Who makes meshes.
    pub meshes: Option<Meshes>,
}

/// A player and where it is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Choice<P> {
    /// Who.
    pub player: P,
    /// Address, where it is not the player's usual one.
    pub address: Option<String>,
    /// Model, where one has to be named.
    pub model: Option<String>,
    /// Why this one.
    pub why: String,
    /// What is missing for it, and what to do about that.
    pub missing: Option<String>,
}

/// A whole cast.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Proposal {
    /// Profile.
    pub profile: Profile,
    /// Who looks.
    pub language: Choice<Language>,
    /// Who draws.
    pub editor: Choice<Editor>,
    /// Who makes meshes.
    pub meshes: Choice<Meshes>,
    /// Who gives boxes.
    pub boxes: Boxes,
}

/// What a player needs.
enum Needs {
    Nothing,
    Key(&'static str),
    Server(fn(ServerKind) -> bool, &'static str),
}

fn of_language(player: Language) -> Needs {
    match player {
        Language::Offline | Language::Files => Needs::Nothing,
        Language::OpenAi | Language::OpenAiChat => Needs::Key("OPENAI_API_KEY"),
        Language::Gemini => Needs::Key("GEMINI_API_KEY"),
        Language::Anthropic => Needs::Key("ANTHROPIC_API_KEY"),
        Language::Compatible => {
            Needs::Server(ServerKind::chats, "start one (docs/players.md, \"Your own server\"), such as `ollama serve`")
        }
    }
}

fn of_editor(player: Editor) -> Needs {
    match player {
        Editor::Offline => Needs::Nothing,
        Editor::Gemini => Needs::Key("GEMINI_API_KEY"),
        Editor::OpenAi => Needs::Key("OPENAI_API_KEY"),
        Editor::LocalEdits => {
            Needs::Server(|kind| kind == ServerKind::SdServer, "start `sd-server` (docs/players.md, \"local_edits\")")
        }
    }
}

fn of_meshes(player: Meshes) -> Needs {
    let start = "start it (docs/players.md, \"Mesh generators\")";
    match player {
        Meshes::Offline | Meshes::Folder | Meshes::Catalogue => Needs::Nothing,
        Meshes::Hunyuan2 => Needs::Server(|kind| kind == ServerKind::Hunyuan2, start),
        Meshes::Hunyuan21 => Needs::Server(|kind| kind == ServerKind::Hunyuan21, start),
        Meshes::TrellisNim => Needs::Server(|kind| kind == ServerKind::Nim, start),
        // LocalAI lists its models as others do.
        Meshes::TrellisLocalAi => Needs::Server(|kind| kind == ServerKind::OtherChat, start),
        Meshes::Fal => Needs::Key("FAL_KEY"),
        Meshes::Replicate => Needs::Key("REPLICATE_API_TOKEN"),
        Meshes::Tripo => Needs::Key("TRIPO_API_KEY"),
        Meshes::Meshy => Needs::Key("MESHY_API_KEY"),
    }
}

/// The wished player, else the first of `order` whose needs are met. The last of them needs nothing.
fn choice<P: Copy + PartialEq>(
    survey: &Survey,
    wish: Option<P>,
    order: &[P],
    needs: fn(P) -> Needs,
    alone: &str,
) -> Choice<P> {
    let met = |player: P| match needs(player) {
        Needs::Nothing => true,
        Needs::Key(variable) => survey.has_key(variable),
        Needs::Server(is, _) => survey.server(is).is_some(),
    };
    let first = order.iter().copied().find(|player| met(*player)).or_else(|| order.last().copied());
    let player = wish.or(first).unwrap_or(order[0]);
    let (mut address, mut model) = (None, None);
    let mut why = if wish.is_some() { "as wished".to_owned() } else { String::new() };
    let mut missing = None;
    let mut because = |text: String| {
        if why.is_empty() {
            why = text;
        }
    };
    match needs(player) {
        Needs::Nothing => because(alone.to_owned()),
        Needs::Key(variable) if survey.has_key(variable) => because(format!("{variable} is set")),
        Needs::Key(variable) => {
            because("nothing else is there".to_owned());
            missing = Some(format!("{variable} is not set: `export {variable}=...` before harmony is started"));
        }
        Needs::Server(is, start) => match survey.server(is) {
            Some(server) => {
                because(format!("{} answers at {}", server.kind.name(), server.address));
                address = Some(server.address.clone());
                // Of several models the user has to name one; the first is as good as any to begin with.
                model = (server.models.len() > 1).then(|| server.models[0].clone());
            }
            None => missing = Some(format!("no such server answers: {start}")),
        },
    }
    Choice { player, address, model, why, missing }
}

/// Chooses a cast.
pub fn propose(survey: &Survey, wish: Wish) -> Proposal {
    let language = choice(
        survey,
        wish.language,
        &[Language::Compatible, Language::Gemini, Language::OpenAi, Language::Offline],
        of_language,
        "no key and no server: rules; `--language files` has you or any chat window answer",
    );
    let editor = choice(
        survey,
        wish.editor,
        &[Editor::LocalEdits, Editor::Gemini, Editor::OpenAi, Editor::Offline],
        of_editor,
        "no key and no server: exemplar fill",
    );
    let meshes = choice(
        survey,
        wish.meshes,
        // A container of NVIDIA may be another one than TRELLIS: it is taken when it is wished for.
        &[
            Meshes::Hunyuan21,
            Meshes::Hunyuan2,
            Meshes::Fal,
            Meshes::Tripo,
            Meshes::Meshy,
            Meshes::Replicate,
            Meshes::Offline,
        ],
        of_meshes,
        "no key and no server: part models and modelling programs",
    );
    let pays = matches!(of_language(language.player), Needs::Key(_))
        || matches!(of_editor(editor.player), Needs::Key(_))
        || matches!(of_meshes(meshes.player), Needs::Key(_));
    let alone = editor.player == Editor::Offline && meshes.player == Meshes::Offline;
    let profile = match language.player {
        _ if pays => Profile::Hosted,
        Language::Offline if alone => Profile::Offline,
        Language::Files if alone => Profile::Files,
        _ => Profile::Local,
    };
    let boxes = match language.player {
        Language::Offline => Boxes::Offline,
        Language::Files => Boxes::WithList,
        _ => Boxes::VlmBoxes,
    };
    Proposal { profile, language, editor, meshes, boxes }
}

impl Proposal {
    /// What is missing, role by role.
    pub fn missing(&self) -> Vec<&str> {
        [&self.language.missing, &self.editor.missing, &self.meshes.missing]
            .into_iter()
            .filter_map(Option::as_deref)
            .collect()
    }
}

#[cfg(test)]
pub(super) mod tests {
    use std::path::PathBuf;

    use super::*;
    use crate::survey::{FoundKey, FoundServer};

    /// A machine with these keys and servers.
    pub fn machine(keys: &[&'static str], servers: &[(ServerKind, &str, &[&str])]) -> Survey {
        let key = |variable: &&'static str| FoundKey { variable, service: "somebody", problem: None };
        let server = |(kind, address, models): &(ServerKind, &str, &[&str])| FoundServer {
            kind: *kind,
            address: (*address).to_owned(),
            models: models.iter().map(|model| (*model).to_owned()).collect(),
        };
        Survey {
            keys: keys.iter().map(key).collect(),
            servers: servers.iter().map(server).collect(),
            gpus: vec![],
            cores: 2,
            memory_mib: Some(8000),
            networks: false,
            weights: vec![],
            folder: PathBuf::from("models"),
            no_blender: None,
            no_network: None,
        }
    }

    #[test]
    fn keys_alone_make_the_hosted_profile() {
        let found = propose(&machine(&["GEMINI_API_KEY", "FAL_KEY"], &[]), Wish::default());
        assert_eq!((found.profile, found.boxes), (Profile::Hosted, Boxes::VlmBoxes));
        assert_eq!(
            (found.language.player, found.editor.player, found.meshes.player),
            (Language::Gemini, Editor::Gemini, Meshes::Fal)
        );
        assert!(found.missing().is_empty());
        // One key less: what it would do this program does.
        let fewer = propose(&machine(&["OPENAI_API_KEY"], &[]), Wish::default());
        assert_eq!((fewer.profile, fewer.meshes.player), (Profile::Hosted, Meshes::Offline));
        let meshy = propose(&machine(&["MESHY_API_KEY"], &[]), Wish::default());
        assert_eq!((meshy.profile, meshy.language.player), (Profile::Hosted, Language::Offline));
    }

    #[test]
    fn servers_of_ones_own_come_before_what_costs() {
        let servers: [(ServerKind, &str, &[&str]); 3] = [
            (ServerKind::Ollama, "http://127.0.0.1:11434/v1", &["qwen3-vl:8b", "gemma3"]),
            (ServerKind::SdServer, "http://127.0.0.1:1234/v1", &["sd-cpp-local"]),
            (ServerKind::Hunyuan2, "http://127.0.0.1:8081", &[]),
        ];
        let found = propose(&machine(&["OPENAI_API_KEY", "FAL_KEY"], &servers), Wish::default());
        assert_eq!(found.profile, Profile::Local);
        assert_eq!(found.language.address.as_deref(), Some("http://127.0.0.1:11434/v1"));
        assert_eq!(found.language.model.as_deref(), Some("qwen3-vl:8b"), "of several, one is named");
        assert_eq!((found.editor.player, found.editor.model), (Editor::LocalEdits, None));
        let wish = Wish { meshes: Some(Meshes::Fal), ..Wish::default() };
        let mixed = propose(&machine(&["FAL_KEY"], &servers), wish);
        assert_eq!((mixed.profile, mixed.meshes.player), (Profile::Hosted, Meshes::Fal));
    }

    #[test]
    fn nothing_at_all_is_this_program_and_wishes_say_what_they_miss() {
        let none = machine(&[], &[]);
        let found = propose(&none, Wish::default());
        assert_eq!((found.profile, found.missing().len()), (Profile::Offline, 0));
        let files = propose(&none, Wish { language: Some(Language::Files), ..Wish::default() });
        assert_eq!((files.profile, files.boxes), (Profile::Files, Boxes::WithList));
        let wish =
            Wish { language: Some(Language::Gemini), editor: Some(Editor::LocalEdits), meshes: Some(Meshes::Hunyuan2) };
        let missing = propose(&none, wish);
        assert_eq!(missing.profile, Profile::Hosted);
        let told = missing.missing();
        assert_eq!(told.len(), 3);
        assert!(told[0].contains("export GEMINI_API_KEY") && told[1].contains("sd-server"), "{told:?}");
    }
}
