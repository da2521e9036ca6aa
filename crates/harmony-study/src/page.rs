//! The page: one HTML file with its style, its script and the list of trials; no address of another site in it.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use serde::{Deserialize, Serialize};
use sha2::{Digest as _, Sha256};

/// What the page knows. Nothing here says which panel is whose.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct PageData {
    pub format: u32,
    pub study: String,
    pub version: String,
    pub title: String,
    pub instructions: String,
    pub consent: String,
    pub trials: Vec<PageTrial>,
}

/// A trial as the page knows it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct PageTrial {
    pub id: String,
    pub size: [u32; 2],
    pub photo: String,
    pub views: Vec<String>,
    pub panels: Vec<PagePanel>,
}

/// A panel as the page knows it; pictures in the order of the trial's views.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct PagePanel {
    pub id: String,
    pub views: Vec<String>,
}

impl PageTrial {
    /// With the pictures themselves in place of their paths.
    pub(crate) fn embedded(mut self, pictures: &[(String, Vec<u8>)]) -> Self {
        let embed = |path: &mut String| {
            if let Some((_, bytes)) = pictures.iter().find(|(name, _)| name == path) {
                *path = format!("data:image/jpeg;base64,{}", STANDARD.encode(bytes));
            }
        };
        embed(&mut self.photo);
        self.panels.iter_mut().flat_map(|p| &mut p.views).for_each(embed);
        self
    }
}

const TEMPLATE: &str = include_str!("../assets/index.html");
const STYLE: &str = include_str!("../assets/study.css");
const SHUFFLE: &str = include_str!("../assets/shuffle.js");
const SCRIPT: &str = include_str!("../assets/study.js");

/// The page's own policy: its script and style by their hashes, pictures beside it, answers to where it came from.
fn policy(script: &str) -> String {
    let hash = |text: &str| STANDARD.encode(Sha256::digest(text.as_bytes()));
    format!(
        "default-src 'none'; script-src 'sha256-{}'; style-src 'sha256-{}'; img-src 'self' data: file:; \
         connect-src 'self'; base-uri 'none'; form-action 'none'",
        hash(script),
        hash(STYLE)
    )
}

/// The page as HTML.
pub(crate) fn page(data: &PageData) -> String {
    let script = format!("\n{SHUFFLE}\n{SCRIPT}\n");
    let json = serde_json::to_string(data)
        .expect("text, numbers and lists have a JSON form")
        .replace('<', "\\u003c")
        .replace('>', "\\u003e")
        .replace('&', "\\u0026")
        .replace('\u{2028}', "\\u2028")
        .replace('\u{2029}', "\\u2029");
    // Each part is put in once, from the end on: what is put in is not searched.
    let parts = [
        ("{{POLICY}}", policy(&script)),
        ("{{TITLE}}", escape(&data.title)),
        ("{{STYLE}}", STYLE.to_owned()),
        ("{{DATA}}", json),
        ("{{SCRIPT}}", script),
    ];
    let mut page = String::new();
    let mut rest = TEMPLATE;
    for (mark, text) in parts {
        let (before, after) = rest.split_once(mark).expect("the template has every mark, in this order");
        page.push_str(before);
        page.push_str(&text);
        rest = after;
    }
    page + rest
}

/// Text as HTML text.
pub(crate) fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;").replace('\'', "&#39;")
}

/// The data of a built page.
pub(crate) fn data_of(html: &str) -> Option<PageData> {
    let (_, rest) = html.split_once("<script type=\"application/json\" id=\"study\">")?;
    let (json, _) = rest.split_once("</script>")?;
    serde_json::from_str(json).ok()
}
