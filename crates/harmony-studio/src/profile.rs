//! `harmony.toml` for a profile whose services are a studio.

use std::fmt::Write as _;

use crate::Studio;
use crate::services::Service;

/// Which profile.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Profile {
    /// gpt-5.5, Gemini's images, Hunyuan3D-2, LocateAnything.
    Paper,
    /// vLLM, sd-server, Hunyuan3D-2, boxes from the language model.
    Local,
    /// Gemini looks, draws and gives boxes, fal makes meshes.
    Hosted,
}

impl Profile {
    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Paper => "paper",
            Self::Local => "local",
            Self::Hosted => "hosted",
        }
    }
}

/// The configuration: the profile with other addresses, nothing else. Keys are taken from the profile's own variables.
pub fn config(studio: &Studio, profile: Profile) -> String {
    let services: &[(&str, &str, Service)] = match profile {
        Profile::Paper => &[
            ("vision_language", "openai", Service::OpenAi),
            ("image_editor", "gemini", Service::Gemini),
            ("mesh_generator", "hunyuan3d_2", Service::Hunyuan2),
            ("detector", "locate_anything", Service::LocateAnything),
        ],
        Profile::Local => &[
            ("vision_language", "compatible", Service::Vllm),
            ("image_editor", "local_edits", Service::SdServer),
            ("mesh_generator", "hunyuan3d_2", Service::Hunyuan2),
        ],
        Profile::Hosted => &[
            ("vision_language", "gemini", Service::Gemini),
            ("image_editor", "gemini", Service::Gemini),
            ("mesh_generator", "fal", Service::Fal),
        ],
    };
    let mut text = format!("profile = \"{}\"\n", profile.name());
    for (role, player, service) in services {
        let _ = write!(text, "\n[players.{role}]\nplayer = \"{player}\"\naddress = \"{}\"\n", studio.base(*service));
    }
    text
}
