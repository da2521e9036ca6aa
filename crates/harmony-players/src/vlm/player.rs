//! A language model behind one of the wire formats.

use async_trait::async_trait;
use harmony_calls::{parse_answer, schema_complaints};
use harmony_roles::{PlayerCard, RoleError, VisionLanguage, VlmAnswer, VlmRequest};
use serde_json::{Value, json};
use tokio::sync::OnceCell;

use super::schema::{Dialect, from_wire, strict, to_wire};
use super::wire::chat::Server;
use super::wire::{Asked, ModelSettings, Reply, Trouble, anthropic, chat, gemini, responses};
use crate::check::{Check, Checked};
use crate::http::{Http, HttpRequest, Received, Service, ServiceOptions, Tokens};
use crate::work::computed;

/// Which format is spoken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// OpenAI's Responses.
    Responses,
    /// Chat completions, of a server that is known or found out.
    Chat(Option<Server>),
    /// Gemini.
    Gemini,
    /// Anthropic.
    Anthropic,
}

impl Format {
    fn dialect(self) -> Dialect {
        match self {
            Self::Responses | Self::Anthropic | Self::Chat(Some(Server::OpenAi)) => Dialect::STRICT,
            Self::Gemini => Dialect::GEMINI,
            Self::Chat(_) => Dialect::GRAMMAR,
        }
    }

    /// Longest side of a picture that the service looks at without shrinking it, pixels.
    fn picture_px(self) -> u32 {
        match self {
            Self::Anthropic => 1568,
            _ => 2048,
        }
    }
}

/// How a language model is set up.
#[derive(Debug, Clone)]
pub struct VlmOptions {
    /// Where and how.
    pub service: ServiceOptions,
    /// Format.
    pub format: Format,
    /// The model and what is set for it. A model without a name is the one that the server serves, if it is one.
    pub settings: ModelSettings,
    /// How many calls may run at once; 0 = no limit.
    pub concurrency: usize,
}

/// A language model.
#[derive(Debug)]
pub struct VlmPlayer {
    service: Service,
    format: Format,
    settings: ModelSettings,
    concurrency: usize,
    /// What was found out about a server that speaks chat completions.
    found: OnceCell<Found>,
}

/// Who answers.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Found {
    server: Option<Server>,
    model: String,
}

impl VlmPlayer {
    /// Sets it up; nothing is sent yet.
    ///
    /// # Errors
    /// [`RoleError::NotSetUp`].
    pub fn new(http: &Http, options: VlmOptions) -> Result<Self, RoleError> {
        let service = Service::new(http, options.service)?;
        if options.settings.model.trim().is_empty() && !matches!(options.format, Format::Chat(_)) {
            return Err(service.not_set_up("no model is named", "set `model` in its section of harmony.toml"));
        }
        Ok(Self {
            service,
            format: options.format,
            settings: options.settings,
            concurrency: options.concurrency,
            found: OnceCell::new(),
        })
    }

    /// The service, for whoever needs its key hidden.
    pub fn service(&self) -> &Service {
        &self.service
    }

    /// Finds out who answers, once: local servers differ, and the model's name may be left to them.
    async fn found(&self) -> Result<&Found, RoleError> {
        self.found.get_or_try_init(|| self.find()).await
    }

    async fn find(&self) -> Result<Found, RoleError> {
        let model = self.settings.model.trim().to_owned();
        let Format::Chat(known) = self.format else { return Ok(Found { server: None, model }) };
        if let (Some(server), false) = (known, model.is_empty()) {
            return Ok(Found { server: Some(server), model });
        }
        let answer = self.service.send(&HttpRequest::get("/models")).await?;
        if !answer.is_success() && (model.is_empty() || answer.status == 401) {
            return Err(self.service.failure(&answer));
        }
        let models: Value = serde_json::from_slice(&answer.body).unwrap_or(Value::Null);
        let server = known.unwrap_or_else(|| Server::from_models(&models, answer.header("server")));
        let model = if model.is_empty() { self.only_model(&models)? } else { model };
        tracing::debug!(player = self.service.player(), ?server, model, "found out who answers");
        Ok(Found { server: Some(server), model })
    }

    /// The model that a server serves, if it is one.
    fn only_model(&self, models: &Value) -> Result<String, RoleError> {
        let names: Vec<&str> = models
            .get("data")
            .and_then(Value::as_array)
            .into_iter()
            .flatten()
            .filter_map(|model| model.get("id")?.as_str())
            .collect();
        match names.as_slice() {
            [one] => Ok((*one).to_owned()),
            [] => Err(self.service.not_set_up("the server names no model", "load a model, or set `model`")),
            many => Err(self.service.not_set_up(
                format!(
                    "the server has {} models: {}",
                    many.len(),
                    many.iter().take(12).copied().collect::<Vec<_>>().join(", ")
                ),
                "set `model` to the one that is meant",
            )),
        }
    }

    /// The request for a question.
    fn request(&self, asked: &Asked, found: &Found) -> HttpRequest {
        let settings = ModelSettings { model: found.model.clone(), ..self.settings.clone() };
        match self.format {
            Format::Responses => HttpRequest::post_json(responses::PATH, &responses::body(asked, &settings)),
            Format::Chat(_) => {
                let server = found.server.unwrap_or(Server::Other);
                HttpRequest::post_json(chat::PATH, &chat::body(asked, &settings, server))
            }
            Format::Gemini => HttpRequest::post_json(&gemini::path(&settings.model), &gemini::body(asked, &settings)),
            Format::Anthropic => HttpRequest::post_json(anthropic::PATH, &anthropic::body(asked, &settings))
                .header(anthropic::VERSION.0, anthropic::VERSION.1),
        }
    }

    /// Asks, and reads the model's text.
    async fn reply(&self, asked: &Asked) -> Result<Received<Reply>, RoleError> {
        let found = self.found().await?;
        let answer = self.service.call(&self.request(asked, found)).await?;
        let (text, closed_for) = (answer.text(), answer.closed_for());
        let body: Value = serde_json::from_slice(&answer.body)
            .map_err(|error| self.service.unusable(format!("the answer's envelope is not JSON: {error}"), &text))?;
        let (read, tokens) = match self.format {
            Format::Responses => (responses::read(&body), responses::tokens(&body)),
            Format::Chat(_) => (chat::read(&body), chat::tokens(&body)),
            Format::Gemini => (gemini::read(&body), gemini::tokens(&body)),
            Format::Anthropic => (anthropic::read(&body), anthropic::tokens(&body)),
        };
        let Tokens { input, output, cached } = tokens;
        tracing::debug!(player = self.service.player(), model = found.model, input, cached, output, "answered");
        if found.server == Some(Server::Ollama)
            && let Some(reason) = chat::prompt_was_cut(asked, tokens)
        {
            return Err(self.service.not_set_up(reason, "start Ollama with OLLAMA_CONTEXT_LENGTH=32768 or more"));
        }
        let value = read.map_err(|trouble| match trouble {
            Trouble::Refused(reason) => self.service.refused(&reason),
            Trouble::CutOff(reason) => self.service.unusable(format!("{reason}; answer more briefly"), &text),
            Trouble::Failed(reason) => self.service.unavailable(reason),
            Trouble::NotUnderstood(reason) => self.service.unusable(reason, &text),
        })?;
        Ok(Received { value, closed_for })
    }
}

/// What the model is told about itself.
const SYSTEM: &str = "You look at pictures of rooms and reason about what is where. \
                      You answer with one JSON value in the given form, and nothing else.";

/// A question in the form that all wire formats take.
fn asked(request: &VlmRequest, dialect: Dialect, longest: u32) -> Result<Asked, String> {
    let pictures = request.pictures.iter().map(|p| super::pictures::encoded(p, longest)).collect::<Result<_, _>>()?;
    let mut prompt = request.prompt.trim_end().to_owned();
    if !request.example.is_null() {
        let example = to_wire(&request.schema, &request.example);
        prompt.push_str(
            "\n\n## Form of the answer\n\nThis example is about another picture and shows the form only:\n\n",
        );
        prompt.push_str(&example.to_string());
        prompt.push('\n');
    }
    Ok(Asked {
        system: SYSTEM.to_owned(),
        prompt,
        pictures,
        schema_name: schema_name(&request.name),
        schema: strict(&request.schema, dialect),
    })
}

/// A name of letters, digits, `_` and `-`, at most 64, from the last part of a call's name.
fn schema_name(name: &str) -> String {
    let last = name.rsplit('/').next().unwrap_or_default();
    let plain: String =
        last.chars().map(|c| if c.is_ascii_alphanumeric() || c == '-' { c } else { '_' }).take(64).collect();
    if plain.is_empty() { "answer".to_owned() } else { plain }
}

#[async_trait]
impl VisionLanguage for VlmPlayer {
    fn card(&self) -> PlayerCard {
        let model = self.found.get().map_or_else(|| self.settings.model.clone(), |found| found.model.clone());
        let model = if model.is_empty() { "as served".to_owned() } else { model };
        PlayerCard { player: self.service.player().to_owned(), model, offline: false, concurrency: self.concurrency }
    }

    async fn ask(&self, request: &VlmRequest) -> Result<VlmAnswer, RoleError> {
        let (dialect, longest) = (self.format.dialect(), self.format.picture_px());
        let player = self.service.player();
        let question = request.clone();
        let asked = computed(player, move || asked(&question, dialect, longest)).await?;
        let asked = asked.map_err(|reason| RoleError::NotCapable { player: player.to_owned(), reason })?;
        let Received { value: reply, closed_for } = self.reply(&asked).await?;
        let value = parse_answer(&reply.text).map_err(|complaint| self.service.unusable(complaint, &reply.text))?;
        let value = from_wire(&request.schema, &value);
        let complaints = schema_complaints(&request.schema, &value);
        if !complaints.is_empty() {
            return Err(self.service.unusable(complaints.join("\n"), &reply.text));
        }
        Ok(VlmAnswer { value, raw: reply.text, usage: reply.tokens.usage(closed_for) })
    }
}

#[async_trait]
impl Check for VlmPlayer {
    async fn check(&self, paid: bool) -> Result<Checked, RoleError> {
        let found = self.found().await?;
        // Looking a model up costs nothing, and needs the key and the name to be right.
        let path = match self.format {
            Format::Responses | Format::Gemini | Format::Anthropic | Format::Chat(Some(Server::OpenAi)) => {
                format!("/models/{}", found.model)
            }
            Format::Chat(_) => "/models".to_owned(),
        };
        let mut request = HttpRequest::get(&path);
        if self.format == Format::Anthropic {
            request = request.header(anthropic::VERSION.0, anthropic::VERSION.1);
        }
        let models = self.service.call(&request).await?;
        if let Format::Chat(_) = self.format
            && found.server != Some(Server::LlamaCpp)
        {
            let models: Value = serde_json::from_slice(&models.body).unwrap_or(Value::Null);
            let listed = models.get("data").and_then(Value::as_array);
            if listed
                .is_some_and(|list| !list.iter().any(|m| m.get("id").and_then(Value::as_str) == Some(&found.model)))
            {
                let reason = format!("the server has no model {:?}", found.model);
                return Err(self.service.not_set_up(reason, "set `model` to a name that the server lists"));
            }
        }
        if !paid {
            let who = found.server.map_or_else(String::new, |server| format!(" ({server:?})"));
            return Ok(Checked { detail: format!("{} is there{who}", found.model), usage: None });
        }
        let question = VlmRequest {
            name: "doctor/check".to_owned(),
            prompt: "Which colour has the picture? Answer with one English word in small letters.".to_owned(),
            pictures: vec![harmony_roles::Picture {
                caption: "IMAGE 1".to_owned(),
                image: std::sync::Arc::new(image::RgbImage::from_pixel(64, 64, image::Rgb([220, 20, 20]))),
            }],
            schema: json!({"type": "object", "properties": {"color": {"type": "string"}}, "required": ["color"],
                           "additionalProperties": false}),
            example: json!({"color": "green"}),
            question: None,
        };
        let answer = self.ask(&question).await?;
        let color = answer.value["color"].as_str().unwrap_or_default().to_lowercase();
        if !color.contains("red") {
            let said = format!("it called a red picture {color:?}: it may not see pictures");
            return Err(self.service.unusable(said, &answer.raw));
        }
        Ok(Checked {
            detail: format!("{} sees pictures and keeps to a schema", found.model),
            usage: Some(answer.usage),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn schema_names_hold_what_services_allow() {
        assert_eq!(schema_name("3_furniture/list"), "list");
        assert_eq!(schema_name("3_furniture/chair_02/front panel?"), "front_panel_");
        assert_eq!(schema_name(""), "answer");
        assert!(schema_name(&"x".repeat(200)).len() == 64);
    }

    #[test]
    fn the_example_is_shown_in_the_form_of_the_wire() {
        let request = VlmRequest {
            name: "x/list".into(),
            prompt: "List them.\n".into(),
            pictures: vec![],
            schema: json!({"type": "array", "items": {"type": "string"}}),
            example: json!(["lamp"]),
            question: None,
        };
        let asked = asked(&request, Dialect::STRICT, 100).unwrap();
        assert!(asked.prompt.starts_with("List them.\n\n## Form"));
        assert!(asked.prompt.contains(r#"{"items":["lamp"]}"#), "{}", asked.prompt);
    }
}
