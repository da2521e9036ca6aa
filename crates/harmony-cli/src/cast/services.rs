//! Hosted and local players from their configuration.

use std::cell::OnceCell;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use harmony_calls::Secret;
use harmony_players::check::Check;
use harmony_players::detector::asked::VlmBoxes;
use harmony_players::detector::boxes::BoxStyle;
use harmony_players::detector::grounding::{GroundingOptions, GroundingPlayer};
use harmony_players::detector::locate::{LocateOptions, LocatePlayer};
use harmony_players::editor::wire::EditSettings;
use harmony_players::editor::{EditorFormat, EditorOptions, EditorPlayer};
use harmony_players::http::{ApiKey, Auth, Http, HttpLimits, KeyError, LocalHosts, Service, ServiceOptions};
use harmony_players::mesh::hosted::tasks::Tasks;
use harmony_players::mesh::hosted::{Host as Hosted, HostedOptions, HostedPlayer};
use harmony_players::mesh::hunyuan::{HunyuanOptions, HunyuanPlayer, Version};
use harmony_players::mesh::trellis::{Host, TrellisOptions, TrellisPlayer};
use harmony_players::vlm::wire::ModelSettings;
use harmony_players::vlm::wire::chat::Server;
use harmony_players::vlm::{Format, PhasedVlm, VlmOptions, VlmPlayer};
use harmony_players::{Catalogue, MeshFolder};
use harmony_roles::{Detector, ImageEditor, MeshGenerator, Role, RoleError, VisionLanguage};

use crate::config::players::{
    Boxes, DetectorConfig, Editor, EditorConfig, Language, LanguageConfig, MeshConfig, Meshes, PlayersConfig,
};

/// What has to be known about a player beside what it plays.
#[derive(Default)]
pub struct Known {
    /// Whether it is there.
    pub checks: Vec<(Role, String, Arc<dyn Check>)>,
    /// Keys, to be kept out of everything that is written.
    pub secrets: Vec<Secret>,
}

impl Known {
    fn add(&mut self, role: Role, service: &Service, check: Arc<dyn Check>) {
        self.checks.push((role, format!("{} at {}", service.player(), service.address()), check));
        self.secrets.extend(service.secret());
    }
}

/// Makes players; `config` is a resolved one.
pub struct Services<'a> {
    /// Made for the first player that needs it: who asks nobody needs no certificates.
    http: OnceCell<Http>,
    config: &'a PlayersConfig,
    /// Where tasks at hosted services are noted; `None` = nowhere but in memory.
    tasks: Option<&'a Path>,
}

impl<'a> Services<'a> {
    /// Players of `config`; nothing is connected yet.
    pub fn new(config: &'a PlayersConfig, tasks: Option<&'a Path>) -> Self {
        Self { http: OnceCell::new(), config, tasks }
    }

    fn http(&self) -> Result<&Http, RoleError> {
        if let Some(http) = self.http.get() {
            return Ok(http);
        }
        let local = self.config.local_only.then(|| LocalHosts {
            named: self.config.local_hosts.iter().map(|host| host.trim().to_ascii_lowercase()).collect(),
        });
        let http = Http::new(local, Duration::from_secs(self.config.connect_secs))?;
        Ok(self.http.get_or_init(|| http))
    }

    fn service(
        &self,
        player: &str,
        role: Role,
        address: Option<&String>,
        key: Option<&String>,
        auth: fn(ApiKey) -> Auth,
        timeout_secs: Option<u64>,
    ) -> Result<ServiceOptions, RoleError> {
        let section = role.folder();
        let auth = match key.map_or("", |variable| variable.trim()) {
            "" => Auth::None,
            variable => auth(ApiKey::from_env(variable).map_err(|error| no_key(player, section, &error))?),
        };
        let total = Duration::from_secs(timeout_secs.unwrap_or(600));
        Ok(ServiceOptions {
            player: player.to_owned(),
            address: address.cloned().unwrap_or_default(),
            remedy: match &auth {
                Auth::None => format!("check `address` and `model` in [players.{section}]"),
                Auth::Bearer(key) | Auth::Header(_, key) | Auth::Scheme(_, key) => {
                    format!("check {}, and `address` and `model` in [players.{section}]", key.variable())
                }
            },
            auth,
            limits: HttpLimits {
                total,
                silence: total.min(HttpLimits::default().silence),
                answer_bytes: self.config.max_answer_mib << 20,
            },
        })
    }

    /// The language model, with other models for some phases; `None` for players without a service.
    ///
    /// # Errors
    /// [`RoleError::NotSetUp`].
    pub fn language(&self, known: &mut Known) -> Result<Option<Arc<dyn VisionLanguage>>, RoleError> {
        let config = &self.config.vision_language;
        let Some(usual) = self.one_language(config, known)? else { return Ok(None) };
        if config.phases.is_empty() {
            return Ok(Some(usual));
        }
        let mut phases: BTreeMap<String, Arc<dyn VisionLanguage>> = BTreeMap::new();
        for (phase, config) in &config.phases {
            if let Some(player) = self.one_language(config, known)? {
                phases.insert(phase.clone(), player);
            }
        }
        Ok(Some(Arc::new(PhasedVlm::new(usual, phases))))
    }

    fn one_language(
        &self,
        config: &LanguageConfig,
        known: &mut Known,
    ) -> Result<Option<Arc<dyn VisionLanguage>>, RoleError> {
        let (name, format, auth): (_, _, fn(ApiKey) -> Auth) = match config.player {
            None | Some(Language::Offline | Language::Files) => return Ok(None),
            Some(Language::OpenAi) => ("openai", Format::Responses, Auth::Bearer),
            Some(Language::OpenAiChat) => ("openai_chat", Format::Chat(Some(Server::OpenAi)), Auth::Bearer),
            Some(Language::Gemini) => ("gemini", Format::Gemini, |key| Auth::Header("x-goog-api-key", key)),
            Some(Language::Anthropic) => ("anthropic", Format::Anthropic, |key| Auth::Header("x-api-key", key)),
            Some(Language::Compatible) => ("compatible", Format::Chat(config.server), Auth::Bearer),
        };
        let (address, key) = (config.address.as_ref(), config.key_env.as_ref());
        let service = self.service(name, Role::VisionLanguage, address, key, auth, config.timeout_secs)?;
        let player = VlmPlayer::new(
            self.http()?,
            VlmOptions {
                service,
                format,
                settings: ModelSettings {
                    model: config.model.clone().unwrap_or_default(),
                    reasoning_effort: config.reasoning_effort.clone(),
                    max_output_tokens: config.max_output_tokens,
                    seed: config.seed,
                    temperature: config.temperature,
                    detail: config.detail.clone().unwrap_or_else(|| "high".to_owned()),
                    extra: config.extra.clone(),
                },
                concurrency: config.concurrency.unwrap_or(0),
            },
        )?;
        let player = Arc::new(player);
        known.add(Role::VisionLanguage, player.service(), player.clone());
        Ok(Some(player))
    }

    /// The image editor; `None` for players without a service.
    ///
    /// # Errors
    /// [`RoleError::NotSetUp`].
    pub fn editor(&self, known: &mut Known) -> Result<Option<Arc<dyn ImageEditor>>, RoleError> {
        let config: &EditorConfig = &self.config.image_editor;
        let (name, format, auth): (_, _, fn(ApiKey) -> Auth) = match config.player {
            None | Some(Editor::Offline) => return Ok(None),
            Some(Editor::Gemini) => ("gemini", EditorFormat::Gemini, |key| Auth::Header("x-goog-api-key", key)),
            Some(Editor::OpenAi) => ("openai", EditorFormat::OpenAi, Auth::Bearer),
            Some(Editor::LocalEdits) => ("local_edits", EditorFormat::Local, Auth::Bearer),
        };
        let (address, key) = (config.address.as_ref(), config.key_env.as_ref());
        let service = self.service(name, Role::ImageEditor, address, key, auth, config.timeout_secs)?;
        let player = Arc::new(EditorPlayer::new(
            self.http()?,
            EditorOptions {
                service,
                format,
                settings: EditSettings {
                    model: config.model.clone().unwrap_or_default(),
                    quality: config.quality.clone().unwrap_or_default(),
                    seed: config.seed,
                    extra: config.extra.clone(),
                },
                concurrency: config.concurrency.unwrap_or(0),
            },
        )?);
        known.add(Role::ImageEditor, player.service(), player.clone());
        Ok(Some(player))
    }

    /// The mesh generator; `None` for the offline player.
    ///
    /// # Errors
    /// [`RoleError::NotSetUp`].
    pub fn meshes(&self, known: &mut Known) -> Result<Option<Arc<dyn MeshGenerator>>, RoleError> {
        let config: &MeshConfig = &self.config.mesh_generator;
        let role = Role::MeshGenerator;
        let service = |name: &str| {
            let (address, key) = (config.address.as_ref(), config.key_env.as_ref());
            self.service(name, role, address, key, Auth::Bearer, config.timeout_secs)
        };
        let path = || {
            config.path.clone().ok_or_else(|| RoleError::NotSetUp {
                player: "mesh generator".to_owned(),
                reason: "no folder is named".to_owned(),
                hint: "set `path` in [players.mesh_generator]".to_owned(),
            })
        };
        let (model, seed) = (config.model.clone().unwrap_or_default(), config.seed.unwrap_or(1234));
        let concurrency = config.concurrency.unwrap_or(1);
        let hunyuan = |name: &str, version| {
            HunyuanPlayer::new(
                self.http()?,
                HunyuanOptions {
                    service: service(name)?,
                    version,
                    model: model.clone(),
                    route: config.route.unwrap_or_default(),
                    texture: config.texture.unwrap_or(true),
                    seed,
                    poll: Duration::from_secs(2),
                    concurrency,
                },
            )
        };
        let trellis = |name: &str, host| {
            let service = service(name)?;
            TrellisPlayer::new(self.http()?, TrellisOptions { service, host, model: model.clone(), seed, concurrency })
        };
        let hosted = |name: &str, host, auth: fn(ApiKey) -> Auth| {
            let (address, key) = (config.address.as_ref(), config.key_env.as_ref());
            let service = self.service(name, role, address, key, auth, config.timeout_secs)?;
            let patience = service.limits.total * 2;
            let options = HostedOptions {
                service,
                host,
                model: model.clone(),
                texture: config.texture.unwrap_or(true),
                seed,
                extra: config.extra.clone(),
                frame: config.frame(),
                usd_per_credit: config.usd_per_credit,
                poll: Duration::from_secs(2),
                patience,
                tasks: Arc::new(self.tasks.map_or_else(Tasks::default, |folder| Tasks::in_folder(folder.to_owned()))),
                concurrency: config.concurrency.unwrap_or(4),
            };
            HostedPlayer::new(self.http()?, options).map(Arc::new)
        };
        Ok(match config.player {
            None | Some(Meshes::Offline) => None,
            Some(player @ (Meshes::Fal | Meshes::Replicate | Meshes::Tripo | Meshes::Meshy)) => {
                let player = match player {
                    Meshes::Fal => hosted("fal", Hosted::Fal, |key| Auth::Scheme("Key", key))?,
                    Meshes::Replicate => hosted("replicate", Hosted::Replicate, Auth::Bearer)?,
                    Meshes::Tripo => hosted("tripo", Hosted::Tripo, Auth::Bearer)?,
                    _ => hosted("meshy", Hosted::Meshy, Auth::Bearer)?,
                };
                known.add(role, player.service(), player.clone());
                Some(player)
            }
            Some(player @ (Meshes::Hunyuan2 | Meshes::Hunyuan21)) => {
                let player = Arc::new(match player {
                    Meshes::Hunyuan21 => hunyuan("hunyuan3d_2_1", Version::V2_1)?,
                    _ => hunyuan("hunyuan3d_2", Version::V2)?,
                });
                known.add(role, player.service(), player.clone());
                Some(player)
            }
            Some(player @ (Meshes::TrellisNim | Meshes::TrellisLocalAi)) => {
                let player = Arc::new(match player {
                    Meshes::TrellisNim => trellis("trellis_nim", Host::Nim)?,
                    _ => trellis("trellis_localai", Host::LocalAi)?,
                });
                known.add(role, player.service(), player.clone());
                Some(player)
            }
            Some(Meshes::Folder) => {
                let player = Arc::new(MeshFolder::new(path()?)?);
                known.checks.push((role, "mesh folder".to_owned(), player.clone()));
                Some(player)
            }
            Some(Meshes::Catalogue) => {
                let player = Arc::new(Catalogue::open(&path()?)?);
                known.checks.push((role, "catalogue".to_owned(), player.clone()));
                Some(player)
            }
        })
    }

    /// The detector; `None` for the offline player and for boxes that come with the lists.
    ///
    /// # Errors
    /// [`RoleError::NotSetUp`].
    pub fn detector(
        &self,
        language: &Arc<dyn VisionLanguage>,
        known: &mut Known,
    ) -> Result<Option<Arc<dyn Detector>>, RoleError> {
        let config: &DetectorConfig = &self.config.detector;
        let service = |name: &str| {
            let (address, key) = (config.address.as_ref(), config.key_env.as_ref());
            self.service(name, Role::Detector, address, key, Auth::Bearer, config.timeout_secs)
        };
        let model = config.model.clone().unwrap_or_default();
        let concurrency = config.concurrency.unwrap_or(1);
        Ok(match config.player {
            None | Some(Boxes::Offline | Boxes::WithList | Boxes::Owlv2) => None,
            Some(Boxes::VlmBoxes) => {
                let style = config.boxes.unwrap_or_else(|| self.usual_boxes());
                let player = Arc::new(VlmBoxes::new(Arc::clone(language), style));
                known.checks.push((Role::Detector, "vlm_boxes".to_owned(), player.clone()));
                Some(player)
            }
            Some(Boxes::LocateAnything) => {
                let options = LocateOptions { service: service("locate_anything")?, model, concurrency };
                let player = Arc::new(LocatePlayer::new(self.http()?, options)?);
                known.add(Role::Detector, player.service(), player.clone());
                Some(player)
            }
            Some(Boxes::GroundingDino) => {
                let service = service("grounding_dino")?;
                let threshold = config.threshold.unwrap_or(0.35);
                let options = GroundingOptions { service, model, threshold, concurrency };
                let player = Arc::new(GroundingPlayer::new(self.http()?, options)?);
                known.add(Role::Detector, player.service(), player.clone());
                Some(player)
            }
        })
    }

    /// How the language model's maker taught it to write boxes.
    fn usual_boxes(&self) -> BoxStyle {
        let model = self.config.vision_language.model.as_deref().unwrap_or_default().to_lowercase();
        match self.config.vision_language.player {
            Some(Language::Gemini) => BoxStyle::ThousandthsTopFirst,
            Some(Language::Compatible) if model.contains("qwen2.5-vl") || model.contains("qwen2_5_vl") => {
                BoxStyle::Pixels
            }
            _ => BoxStyle::Thousandths,
        }
    }
}

fn no_key(player: &str, section: &str, error: &KeyError) -> RoleError {
    let hint = match error {
        KeyError::NotSet { variable } => format!(
            "set {variable} to your key, or set `player` in [players.{section}] of harmony.toml to one that needs none"
        ),
        _ => format!("`key_env` in [players.{section}] is the NAME of the variable; the variable holds the key"),
    };
    RoleError::NotSetUp { player: player.to_owned(), reason: error.to_string(), hint }
}
