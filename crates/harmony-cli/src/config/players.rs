//! `[players]`: hosted and local players, role by role.
//!
//! What a user leaves out is the profile's, or the player's usual value. [`PlayersConfig::resolved`] merges them.

use std::collections::BTreeMap;
use std::path::PathBuf;

use harmony_pipeline::Phase;
use harmony_players::detector::boxes::BoxStyle;
use harmony_players::http::check_variable;
use harmony_players::mesh::finish::{AxisName, SourceFrame};
use harmony_players::mesh::hunyuan::Route;
use harmony_players::vlm::wire::chat::Server;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use super::Profile;
use super::networks::{Device, Geometry, GeometryConfig, Masks, SegmenterConfig};

/// Longest deadline of a call, seconds: a day.
const MAX_TIMEOUT_SECS: u64 = 86_400;

/// Hosted and local players: those of the profiles `paper`, `local` and `hosted`, and networks for `files`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PlayersConfig {
    /// Nothing may leave the machine: only loopback addresses and `local_hosts` are reached, no proxy is used.
    pub local_only: bool,
    /// Further hosts that count as this machine, by name or address.
    pub local_hosts: Vec<String>,
    /// Seconds for a connection to stand.
    pub connect_secs: u64,
    /// Largest answer that is read, MiB.
    pub max_answer_mib: u64,
    /// The language model.
    pub vision_language: LanguageConfig,
    /// The image editor.
    pub image_editor: EditorConfig,
    /// The mesh generator.
    pub mesh_generator: MeshConfig,
    /// The detector.
    pub detector: DetectorConfig,
    /// The geometry estimator, a network inside this program.
    pub geometry_estimator: GeometryConfig,
    /// The segmenter, a network inside this program.
    pub segmenter: SegmenterConfig,
}

impl Default for PlayersConfig {
    fn default() -> Self {
        Self {
            local_only: false,
            local_hosts: Vec::new(),
            connect_secs: 10,
            max_answer_mib: 64,
            vision_language: LanguageConfig::default(),
            image_editor: EditorConfig::default(),
            mesh_generator: MeshConfig::default(),
            detector: DetectorConfig::default(),
            geometry_estimator: GeometryConfig::default(),
            segmenter: SegmenterConfig::default(),
        }
    }
}

/// Who can be the language model.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Language {
    /// Rules.
    Offline,
    /// Whoever answers question folders.
    Files,
    /// OpenAI's Responses.
    #[serde(rename = "openai")]
    OpenAi,
    /// OpenAI's chat completions.
    #[serde(rename = "openai_chat")]
    OpenAiChat,
    /// Gemini.
    Gemini,
    /// Anthropic.
    Anthropic,
    /// A server that speaks chat completions: vLLM, llama.cpp, Ollama, mistral.rs and others.
    Compatible,
}

/// Who can be the image editor.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Editor {
    /// Exemplar fill.
    Offline,
    /// Gemini's image models.
    Gemini,
    /// OpenAI's `images/edits`.
    #[serde(rename = "openai")]
    OpenAi,
    /// A local server with `images/edits`, such as `sd-server`.
    LocalEdits,
}

/// Who can be the mesh generator.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Meshes {
    /// Part models.
    Offline,
    /// Hunyuan3D-2's server.
    #[serde(rename = "hunyuan3d_2")]
    Hunyuan2,
    /// Hunyuan3D-2.1's server.
    #[serde(rename = "hunyuan3d_2_1")]
    Hunyuan21,
    /// NVIDIA's container of TRELLIS.
    TrellisNim,
    /// LocalAI with TRELLIS.2.
    #[serde(rename = "trellis_localai")]
    TrellisLocalAi,
    /// Hosted: models at fal.ai.
    Fal,
    /// Hosted: models at Replicate.
    Replicate,
    /// Hosted: Tripo.
    Tripo,
    /// Hosted: Meshy.
    Meshy,
    /// A folder of GLB files named by object or label.
    Folder,
    /// A folder with an index, or a furniture library of Sweet Home 3D.
    Catalogue,
}

/// Who can be the detector.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Boxes {
    /// Regions by rules.
    Offline,
    /// The language model gives boxes with its lists.
    WithList,
    /// The language model is asked for boxes.
    VlmBoxes,
    /// LocateAnything behind a server that speaks chat completions.
    LocateAnything,
    /// Zero-shot detection in the form of Hugging Face's task.
    GroundingDino,
    /// OWLv2 inside this program.
    Owlv2,
}

/// The language model.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LanguageConfig {
    /// Who.
    pub player: Option<Language>,
    /// Base address, up to and with the version (`.../v1`).
    pub address: Option<String>,
    /// Model name; empty = the one that a local server serves.
    pub model: Option<String>,
    /// Name of the environment variable that holds the key; empty = no key is sent.
    pub key_env: Option<String>,
    /// Which server speaks chat completions; left out = found out.
    pub server: Option<Server>,
    /// How much the model thinks, in the service's words.
    pub reasoning_effort: Option<String>,
    /// Most tokens of an answer, thinking included.
    pub max_output_tokens: Option<u32>,
    /// Seed.
    pub seed: Option<u64>,
    /// Sampling temperature; reasoning models take none.
    pub temperature: Option<f64>,
    /// How finely OpenAI looks at pictures: `low`, `high`, `auto`, `original`.
    pub detail: Option<String>,
    /// Calls at once; 0 = no limit.
    pub concurrency: Option<usize>,
    /// Deadline of a call, seconds.
    pub timeout_secs: Option<u64>,
    /// Further properties of the request.
    #[serde(skip_serializing_if = "Map::is_empty")]
    pub extra: Map<String, Value>,
    /// Other settings for the questions of some phases (`layout`, `wall`, `furniture`, `ceiling`, `decoration`,
    /// `lighting`); what is left out is as above.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub phases: BTreeMap<String, LanguageConfig>,
}

/// The image editor.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct EditorConfig {
    /// Who.
    pub player: Option<Editor>,
    /// Base address.
    pub address: Option<String>,
    /// Model name.
    pub model: Option<String>,
    /// Name of the environment variable that holds the key.
    pub key_env: Option<String>,
    /// OpenAI: `low`, `medium`, `high`.
    pub quality: Option<String>,
    /// Seed.
    pub seed: Option<u64>,
    /// Calls at once; 0 = no limit.
    pub concurrency: Option<usize>,
    /// Deadline of a call, seconds.
    pub timeout_secs: Option<u64>,
    /// Further properties of the request.
    #[serde(skip_serializing_if = "Map::is_empty")]
    pub extra: Map<String, Value>,
}

/// The mesh generator.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MeshConfig {
    /// Who.
    pub player: Option<Meshes>,
    /// Base address.
    pub address: Option<String>,
    /// Model name, for LocalAI and for records.
    pub model: Option<String>,
    /// Name of the environment variable that holds the key.
    pub key_env: Option<String>,
    /// Folder or library, for `folder` and `catalogue`.
    pub path: Option<PathBuf>,
    /// Hunyuan3D: `generate` (one request) or `send` (a job).
    pub route: Option<Route>,
    /// Hunyuan3D and hosted services: whether meshes are textured; a server of one's own must have been started for it.
    pub texture: Option<bool>,
    /// Seed.
    pub seed: Option<u32>,
    /// Hosted services: the axis of their meshes that points up; left out = as the service's module says.
    pub up: Option<AxisName>,
    /// Hosted services: the axis along which the front looks; left out = as the service's module says.
    pub front: Option<AxisName>,
    /// Hosted services that tell credits: US dollars for one; left out = the price table holds.
    pub usd_per_credit: Option<f64>,
    /// Calls at once.
    pub concurrency: Option<usize>,
    /// Deadline of a call, seconds; hosted: a task that is at work for twice as long is given up.
    pub timeout_secs: Option<u64>,
    /// Hosted services: further properties of the request.
    #[serde(skip_serializing_if = "Map::is_empty")]
    pub extra: Map<String, Value>,
}

/// The detector.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DetectorConfig {
    /// Who.
    pub player: Option<Boxes>,
    /// Base address; for `grounding_dino` that of the route.
    pub address: Option<String>,
    /// Model name.
    pub model: Option<String>,
    /// Name of the environment variable that holds the key.
    pub key_env: Option<String>,
    /// `grounding_dino`: least score.
    pub threshold: Option<f64>,
    /// `vlm_boxes`: how the language model writes boxes; left out = as its maker taught it.
    pub boxes: Option<BoxStyle>,
    /// OWLv2 inside this program instead, where its weights are; left out = true when no player and no address is set.
    pub native: Option<bool>,
    /// `owlv2`: a folder of one's own with `model.safetensors` and the vocabulary; then `model` says of which size.
    pub weights: Option<PathBuf>,
    /// `owlv2`: where it runs.
    pub device: Option<Device>,
    /// Calls at once.
    pub concurrency: Option<usize>,
    /// Deadline of a call, seconds.
    pub timeout_secs: Option<u64>,
}

/// Takes what is not set from `usual`.
macro_rules! fill {
    ($config:ident from $usual:ident: $($field:ident),*) => {
        $(if $config.$field.is_none() { $config.$field = $usual.$field; })*
    };
}

#[expect(clippy::unnecessary_wraps, reason = "fields that a user may leave out")]
fn text(text: &str) -> Option<String> {
    Some(text.to_owned())
}

impl Language {
    /// What is usual for a player.
    fn usual(self) -> LanguageConfig {
        let at = |address: &str, model: &str, key: &str, concurrency| LanguageConfig {
            player: Some(self),
            address: text(address),
            model: text(model),
            key_env: text(key),
            detail: text("high"),
            concurrency: Some(concurrency),
            timeout_secs: Some(600),
            ..LanguageConfig::default()
        };
        match self {
            Self::Offline | Self::Files => LanguageConfig { player: Some(self), ..LanguageConfig::default() },
            Self::OpenAi | Self::OpenAiChat => at("https://api.openai.com/v1", "gpt-5.5", "OPENAI_API_KEY", 8),
            Self::Gemini => {
                at("https://generativelanguage.googleapis.com/v1beta", "gemini-3.6-flash", "GEMINI_API_KEY", 8)
            }
            // Anthropic's names change by date: the user names one.
            Self::Anthropic => at("https://api.anthropic.com/v1", "", "ANTHROPIC_API_KEY", 4),
            Self::Compatible => at("http://127.0.0.1:8000/v1", "", "", 2),
        }
    }
}

impl LanguageConfig {
    fn filled(mut self, usual: LanguageConfig) -> Self {
        fill!(self from usual: player, address, model, key_env, server, reasoning_effort, max_output_tokens, seed,
              temperature, detail, concurrency, timeout_secs);
        if self.extra.is_empty() {
            self.extra = usual.extra;
        }
        self
    }
}

impl EditorConfig {
    fn usual(player: Editor) -> Self {
        let at = |address: &str, model: &str, key: &str, concurrency| Self {
            player: Some(player),
            address: text(address),
            model: text(model),
            key_env: text(key),
            concurrency: Some(concurrency),
            timeout_secs: Some(300),
            ..Self::default()
        };
        match player {
            Editor::Offline => Self { player: Some(player), ..Self::default() },
            // The paper's 2.5 Flash Image was to end on 2 October 2026; this is its successor.
            Editor::Gemini => {
                at("https://generativelanguage.googleapis.com/v1beta", "gemini-3.1-flash-image", "GEMINI_API_KEY", 4)
            }
            Editor::OpenAi => at("https://api.openai.com/v1", "gpt-image-1.5", "OPENAI_API_KEY", 4),
            Editor::LocalEdits => at("http://127.0.0.1:1234/v1", "", "", 1),
        }
    }

    fn filled(mut self, usual: Self) -> Self {
        fill!(self from usual: player, address, model, key_env, quality, seed, concurrency, timeout_secs);
        self
    }
}

impl MeshConfig {
    fn usual(player: Meshes) -> Self {
        let at = |address: &str, model: &str| Self {
            player: Some(player),
            address: text(address),
            model: text(model),
            key_env: text(""),
            seed: Some(1234),
            concurrency: Some(1),
            timeout_secs: Some(900),
            ..Self::default()
        };
        let hunyuan = |model: &str| Self {
            route: Some(Route::Generate),
            texture: Some(true),
            ..at("http://127.0.0.1:8081", model)
        };
        let hosted = |address: &str, model: &str, key: &str| Self {
            key_env: text(key),
            texture: Some(true),
            concurrency: Some(4),
            ..at(address, model)
        };
        match player {
            Meshes::Offline | Meshes::Folder | Meshes::Catalogue => Self { player: Some(player), ..Self::default() },
            Meshes::Hunyuan2 => hunyuan("hunyuan3d-2"),
            Meshes::Hunyuan21 => hunyuan("hunyuan3d-2.1"),
            Meshes::TrellisNim => at("http://127.0.0.1:8000", "trellis"),
            Meshes::TrellisLocalAi => at("http://127.0.0.1:8080", ""),
            // The cheapest one whose page was read, and whose weights anybody may use.
            Meshes::Fal => Self {
                // New accounts get two at a time; what is more waits in the service's own queue.
                concurrency: Some(8),
                ..hosted("https://queue.fal.run", "fal-ai/trellis", "FAL_KEY")
            },
            // A model that is not Replicate's own is named with its version.
            Meshes::Replicate => hosted(
                "https://api.replicate.com/v1",
                "firtoz/trellis:e8f6c45206993f297372f5436b90350817bd9b4a0d52d2a76df50c1c8afa2b3c",
                "REPLICATE_API_TOKEN",
            ),
            Meshes::Tripo => hosted("https://api.tripo3d.ai/v2/openapi", "v2.5-20250123", "TRIPO_API_KEY"),
            Meshes::Meshy => hosted("https://api.meshy.ai", "meshy-6", "MESHY_API_KEY"),
        }
    }

    fn filled(mut self, usual: Self) -> Self {
        fill!(self from usual: player, address, model, key_env, path, route, texture, seed, up, front, usd_per_credit,
              concurrency, timeout_secs);
        if self.extra.is_empty() {
            self.extra = usual.extra;
        }
        self
    }

    /// The frame of a hosted service's meshes, where the user says one; what is left out of it is glTF's.
    #[must_use]
    pub fn frame(&self) -> Option<SourceFrame> {
        let usual = SourceFrame::default();
        (self.up.is_some() || self.front.is_some())
            .then(|| SourceFrame { up: self.up.unwrap_or(usual.up), front: self.front.unwrap_or(usual.front) })
    }
}

impl DetectorConfig {
    fn usual(player: Boxes) -> Self {
        let at = |address: &str, model: &str| Self {
            player: Some(player),
            address: text(address),
            model: text(model),
            key_env: text(""),
            concurrency: Some(1),
            timeout_secs: Some(300),
            ..Self::default()
        };
        match player {
            Boxes::Offline | Boxes::WithList | Boxes::VlmBoxes | Boxes::Owlv2 => {
                Self { player: Some(player), ..Self::default() }
            }
            Boxes::LocateAnything => at("http://127.0.0.1:8080/v1", "LocateAnything-3B"),
            Boxes::GroundingDino => {
                Self { threshold: Some(0.35), ..at("http://127.0.0.1:8082/", "grounding-dino-base") }
            }
        }
    }

    fn filled(mut self, usual: Self) -> Self {
        let named = self.player.is_some() || self.address.is_some();
        self.native = self.native.or(Some(!named)).filter(|_| usual.player != Some(Boxes::Offline));
        fill!(self from usual: player, address, model, key_env, threshold, boxes, concurrency, timeout_secs);
        self
    }
}

impl Profile {
    /// Who plays in a profile, before the user changes anything.
    fn cast(self) -> (Language, Editor, Meshes, Boxes) {
        match self {
            Self::Offline => (Language::Offline, Editor::Offline, Meshes::Offline, Boxes::Offline),
            Self::Files => (Language::Files, Editor::Offline, Meshes::Offline, Boxes::WithList),
            Self::Paper => (Language::OpenAi, Editor::Gemini, Meshes::Hunyuan2, Boxes::LocateAnything),
            Self::Local => (Language::Compatible, Editor::LocalEdits, Meshes::Hunyuan2, Boxes::VlmBoxes),
            // One key for looking, drawing and boxes, one for meshes; Gemini was taught boxes.
            Self::Hosted => (Language::Gemini, Editor::Gemini, Meshes::Fal, Boxes::VlmBoxes),
        }
    }
}

impl PlayersConfig {
    /// What holds for a profile: its own cast, changed by what the user wrote. `offline` is not changed; `files` takes
    /// networks inside this program that are named (`player`), which ask nobody else and cost nothing.
    #[must_use]
    pub fn resolved(&self, profile: Profile) -> Self {
        let (language, editor, meshes, boxes) = profile.cast();
        let own = match profile {
            Profile::Offline => self.clone().without_services().without_networks(),
            Profile::Files => self.with_named_networks(),
            Profile::Paper | Profile::Local | Profile::Hosted => self.clone(),
        };
        let language = own.vision_language.player.unwrap_or(language).usual();
        let mut vision_language = own.vision_language.filled(language);
        let main = LanguageConfig { phases: BTreeMap::new(), ..vision_language.clone() };
        for config in vision_language.phases.values_mut() {
            let usual = match config.player {
                Some(player) if Some(player) != main.player => player.usual(),
                _ => main.clone(),
            };
            *config = std::mem::take(config).filled(usual);
        }
        Self {
            vision_language,
            image_editor: {
                let usual = EditorConfig::usual(own.image_editor.player.unwrap_or(editor));
                own.image_editor.filled(usual)
            },
            mesh_generator: {
                let usual = MeshConfig::usual(own.mesh_generator.player.unwrap_or(meshes));
                own.mesh_generator.filled(usual)
            },
            detector: {
                let usual = DetectorConfig::usual(own.detector.player.unwrap_or(boxes));
                own.detector.filled(usual)
            },
            ..own
        }
    }

    /// Services and servers as if nothing was written of them.
    fn without_services(self) -> Self {
        Self {
            vision_language: LanguageConfig::default(),
            image_editor: EditorConfig::default(),
            mesh_generator: MeshConfig::default(),
            detector: DetectorConfig::default(),
            ..self
        }
    }

    /// Of all that is written only the networks inside this program whose `player` is named.
    fn with_named_networks(&self) -> Self {
        let mut own = self.clone().without_services().without_networks();
        if self.geometry_estimator.player.is_some() {
            own.geometry_estimator = self.geometry_estimator.clone();
        }
        if self.segmenter.player.is_some() {
            own.segmenter = self.segmenter.clone();
        }
        if self.detector.player == Some(Boxes::Owlv2) {
            own.detector = self.detector.clone();
        }
        own
    }

    /// The same without keys, for an estimate that asks nobody.
    #[must_use]
    pub fn without_keys(mut self) -> Self {
        let (v, e, m, d) =
            (&mut self.vision_language, &mut self.image_editor, &mut self.mesh_generator, &mut self.detector);
        for key in [&mut v.key_env, &mut e.key_env, &mut m.key_env, &mut d.key_env] {
            *key = None;
        }
        v.phases.values_mut().for_each(|config| config.key_env = None);
        self
    }

    /// The same without networks inside this program, for an estimate that loads nothing.
    #[must_use]
    pub fn without_networks(mut self) -> Self {
        self.geometry_estimator = GeometryConfig { player: Some(Geometry::Offline), ..GeometryConfig::default() };
        self.segmenter = SegmenterConfig { player: Some(Masks::Offline), ..SegmenterConfig::default() };
        self.detector.native = Some(false);
        self
    }

    /// Whether every value is one that can be used.
    ///
    /// # Errors
    /// Which is not, with the allowed range.
    pub fn check(&self) -> Result<(), String> {
        let in_range = |name: &str, value: Option<u64>, low: u64, high: u64| match value {
            Some(value) if !(low..=high).contains(&value) => {
                Err(format!("players.{name} is {value}; allowed is {low} to {high}"))
            }
            _ => Ok(()),
        };
        in_range("connect_secs", Some(self.connect_secs), 1, 600)?;
        in_range("max_answer_mib", Some(self.max_answer_mib), 1, 4096)?;
        let (v, e, m, d) = (&self.vision_language, &self.image_editor, &self.mesh_generator, &self.detector);
        for (name, timeout) in [
            ("vision_language", v.timeout_secs),
            ("image_editor", e.timeout_secs),
            ("mesh_generator", m.timeout_secs),
            ("detector", d.timeout_secs),
        ] {
            in_range(&format!("{name}.timeout_secs"), timeout, 1, MAX_TIMEOUT_SECS)?;
        }
        let keys = [&v.key_env, &e.key_env, &m.key_env, &d.key_env];
        for variable in keys.into_iter().chain(v.phases.values().map(|c| &c.key_env)).flatten() {
            if !variable.is_empty() {
                check_variable(variable).map_err(|error| format!("players: key_env: {error}"))?;
            }
        }
        if let Some(usd) = m.usd_per_credit.filter(|usd| !(0.0..=1000.0).contains(usd)) {
            return Err(format!("players.mesh_generator.usd_per_credit is {usd}; allowed is 0 to 1000"));
        }
        if let Some(frame) = m.frame() {
            frame.canonical_from_source().map_err(|error| format!("players.mesh_generator: up and front: {error}"))?;
        }
        if let Some(threshold) = d.threshold.filter(|t| !(0.0..=1.0).contains(t)) {
            return Err(format!("players.detector.threshold is {threshold}; allowed is 0 to 1"));
        }
        for (phase, config) in &v.phases {
            if Phase::ALL.into_iter().all(|p| p.name() != phase) {
                let known = Phase::names();
                return Err(format!("players.vision_language.phases.{phase}: phases are {known}"));
            }
            in_range(
                &format!("vision_language.phases.{phase}.timeout_secs"),
                config.timeout_secs,
                1,
                MAX_TIMEOUT_SECS,
            )?;
            if !config.phases.is_empty() || matches!(config.player, Some(Language::Offline | Language::Files)) {
                return Err(format!(
                    "players.vision_language.phases.{phase}: only another service or model can be set"
                ));
            }
        }
        Ok(())
    }
}

/// The players of the profiles that have some, as comments for `harmony schema config`.
///
/// # Errors
/// None in practice.
pub fn described() -> Result<String, toml::ser::Error> {
    #[derive(Serialize)]
    struct Shown {
        players: PlayersConfig,
    }
    let mut text = String::new();
    for profile in [Profile::Paper, Profile::Local, Profile::Hosted] {
        text.extend(["\n# What `profile = \"", profile.name(), "\"` plays, unless it is changed:\n#\n"]);
        let shown = Shown { players: PlayersConfig::default().resolved(profile) };
        for line in toml::to_string_pretty(&shown)?.lines() {
            text.extend([format!("# {line}").trim_end(), "\n"]);
        }
    }
    text.push_str(
        "\n# Players that can be set: vision_language: openai, openai_chat, gemini, anthropic, compatible, files, offline;\n\
         # image_editor: gemini, openai, local_edits, offline; mesh_generator: hunyuan3d_2, hunyuan3d_2_1, trellis_nim,\n\
         # trellis_localai, fal, replicate, tripo, meshy, folder, catalogue, offline; detector: locate_anything, grounding_dino, vlm_boxes, with_list,\n\
         # owlv2, offline (`native = true`: owlv2 where its weights are); geometry_estimator: vggt, offline; segmenter: sam2,\n\
         # offline (left out: the network where its weights are; each has `model`, `weights` and `device` = auto, cpu, cuda).\n\
         # `[players.vision_language.phases.lighting]` and the like set another model for a phase.\n\
         # What calls cost stands in `[prices]`, rates in `[limits.players]`; calls at a time stand here (`concurrency`).\n",
    );
    Ok(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(text: &str) -> PlayersConfig {
        super::super::parse(text).unwrap().players
    }

    #[test]
    fn the_papers_cast_is_the_papers() {
        let paper = PlayersConfig::default().resolved(Profile::Paper);
        assert_eq!(paper.vision_language.model.as_deref(), Some("gpt-5.5"));
        assert_eq!(paper.image_editor.player, Some(Editor::Gemini));
        assert_eq!(paper.mesh_generator.player, Some(Meshes::Hunyuan2));
        assert_eq!(paper.detector.player, Some(Boxes::LocateAnything));
        let offline = PlayersConfig::default().resolved(Profile::Offline);
        assert_eq!(offline.vision_language.player, Some(Language::Offline));
    }

    #[test]
    fn the_hosted_cast_needs_two_keys_and_no_server() {
        let hosted = PlayersConfig::default().resolved(Profile::Hosted);
        let (v, e, m, d) = (hosted.vision_language, hosted.image_editor, hosted.mesh_generator, hosted.detector);
        let keys = [v.key_env, e.key_env, m.key_env].map(Option::unwrap_or_default);
        assert_eq!(keys, ["GEMINI_API_KEY", "GEMINI_API_KEY", "FAL_KEY"]);
        assert_eq!((d.player, d.native), (Some(Boxes::VlmBoxes), Some(true)));
        assert!([v.address, e.address, m.address].into_iter().flatten().all(|at| at.starts_with("https://")));
        let other = "[players.mesh_generator]\nplayer = \"tripo\"\nfront = \"-z\"\nusd_per_credit = 0.01\n\
                     [players.mesh_generator.extra]\ntexture_quality = \"detailed\"\n";
        let tripo = parsed(other).resolved(Profile::Hosted).mesh_generator;
        assert_eq!(tripo.key_env.as_deref(), Some("TRIPO_API_KEY"));
        assert_eq!(tripo.frame(), Some(SourceFrame { up: AxisName::PlusY, front: AxisName::MinusZ }));
        assert_eq!(tripo.extra["texture_quality"], "detailed");
        for (wrong, word) in [("front = \"+y\"", "one axis"), ("usd_per_credit = -1.0", "usd_per_credit")] {
            let error = super::super::parse(&format!("[players.mesh_generator]\n{wrong}\n")).unwrap_err();
            assert!(error.contains(word), "{error}");
        }
    }

    #[test]
    fn networks_play_where_nobody_else_is_named() {
        let text = "[players.geometry_estimator]\ndevice = \"cpu\"\n";
        let local = parsed(text).resolved(Profile::Local);
        assert_eq!((local.geometry_estimator.player, local.geometry_estimator.device), (None, Some(Device::Cpu)));
        assert_eq!((local.detector.player, local.detector.native), (Some(Boxes::VlmBoxes), Some(true)));
        let served = "[players.detector]\nplayer = \"locate_anything\"\n";
        assert_eq!(parsed(served).resolved(Profile::Paper).detector.native, Some(false));
        let served = "[players.detector]\naddress = \"http://127.0.0.1:9/v1\"\n";
        assert_eq!(parsed(served).resolved(Profile::Paper).detector.native, Some(false));
        for profile in [Profile::Offline, Profile::Files] {
            let none = parsed(text).resolved(profile);
            assert_eq!(none.geometry_estimator.player, Some(Geometry::Offline));
            assert_eq!(none.segmenter.player, Some(Masks::Offline));
            assert_ne!(none.detector.native, Some(true));
        }
        // Whoever answers by hand may name networks, which cost nothing; services that the file names are not asked.
        let named = "[players.geometry_estimator]\nplayer = \"vggt\"\n[players.segmenter]\nplayer = \"sam2\"\n\
                     model = \"sam2.1-tiny\"\n[players.detector]\nplayer = \"owlv2\"\n\
                     [players.mesh_generator]\nplayer = \"fal\"\n";
        let files = parsed(named).resolved(Profile::Files);
        assert_eq!(files.geometry_estimator.player, Some(Geometry::Vggt));
        assert_eq!(files.segmenter.model.as_deref(), Some("sam2.1-tiny"));
        assert_eq!((files.detector.player, files.detector.native), (Some(Boxes::Owlv2), Some(false)));
        assert_eq!(files.mesh_generator.player, Some(Meshes::Offline));
        assert_eq!(parsed(named).resolved(Profile::Offline), PlayersConfig::default().resolved(Profile::Offline));
        let served = "[players.detector]\nplayer = \"locate_anything\"\n";
        assert_eq!(parsed(served).resolved(Profile::Files).detector.player, Some(Boxes::WithList));
        let wrong = super::super::parse("[players.segmenter]\ndevice = \"tpu\"\n").unwrap_err();
        assert!(wrong.contains("tpu") && wrong.contains("cuda"), "{wrong}");
    }

    #[test]
    fn what_is_written_wins_and_another_player_brings_its_own_usual_values() {
        let text = "[players.vision_language]\nmodel = \"gpt-5.6\"\n[players.image_editor]\nplayer = \"openai\"\n\
                    [players.vision_language.phases.lighting]\nmodel = \"small\"\n\
                    [players.vision_language.phases.wall]\nplayer = \"gemini\"\n";
        let paper = parsed(text).resolved(Profile::Paper);
        assert_eq!(paper.vision_language.model.as_deref(), Some("gpt-5.6"));
        assert_eq!(paper.vision_language.key_env.as_deref(), Some("OPENAI_API_KEY"));
        assert_eq!(paper.image_editor.model.as_deref(), Some("gpt-image-1.5"));
        let lighting = &paper.vision_language.phases["lighting"];
        assert_eq!((lighting.model.as_deref(), lighting.key_env.as_deref()), (Some("small"), Some("OPENAI_API_KEY")));
        assert_eq!(paper.vision_language.phases["wall"].key_env.as_deref(), Some("GEMINI_API_KEY"));
        let offline = parsed(text).resolved(Profile::Offline);
        assert_eq!(offline.image_editor.player, Some(Editor::Offline), "offline stays offline");
    }

    #[test]
    fn mistakes_are_named_and_a_key_is_not_repeated() {
        for (text, word) in [
            ("[players.vision_language]\nmodle = \"x\"\n", "modle"),
            ("[players.vision_language]\nplayer = \"gpt\"\n", "openai_chat"),
            ("[players.vision_language.phases.garden]\nmodel = \"x\"\n", "garden"),
            ("[players.detector]\nthreshold = 3.0\n", "threshold"),
            ("[players]\nmax_answer_mib = 0\n", "max_answer_mib"),
            ("[players.vision_language.prices]\nper_call = 1.0\n", "prices"),
            ("[players.vision_language]\nkey_env = \"sk-canary-123456789\"\n", "key_env"),
        ] {
            let error = super::super::parse(text).unwrap_err();
            assert!(error.contains(word), "{error}");
            assert!(!error.contains("canary"), "{error}");
        }
    }

    #[test]
    fn what_the_schema_shows_can_be_read_again() {
        let text = described().unwrap();
        for profile in [Profile::Paper, Profile::Local, Profile::Hosted] {
            let start = text.find(&format!("profile = \"{}\"", profile.name())).unwrap();
            let lines = text[start..].lines().skip(2).take_while(|line| line.starts_with("# "));
            let toml = lines.map(|line| &line[2..]).collect::<Vec<_>>().join("\n");
            let shown = super::super::parse(&toml).unwrap().players;
            assert_eq!(shown.resolved(profile), PlayersConfig::default().resolved(profile), "{toml}");
        }
    }
}
