//! Another model for some phases.

use std::collections::BTreeMap;
use std::sync::Arc;

use async_trait::async_trait;
use harmony_roles::{PlayerCard, RoleError, VisionLanguage, VlmAnswer, VlmRequest};

/// A language model for most questions, others for the questions of some phases.
pub struct PhasedVlm {
    usual: Arc<dyn VisionLanguage>,
    phases: BTreeMap<String, Arc<dyn VisionLanguage>>,
}

impl PhasedVlm {
    /// `phases` goes by the phase's name without its number, such as `furniture`.
    pub fn new(usual: Arc<dyn VisionLanguage>, phases: BTreeMap<String, Arc<dyn VisionLanguage>>) -> Self {
        Self { usual, phases }
    }

    /// Who answers a question of this name.
    fn for_name(&self, name: &str) -> &Arc<dyn VisionLanguage> {
        let phase = name.split('/').next().unwrap_or_default();
        let phase = phase.trim_start_matches(|c: char| c.is_ascii_digit() || c == '_');
        self.phases.get(phase).unwrap_or(&self.usual)
    }
}

#[async_trait]
impl VisionLanguage for PhasedVlm {
    /// One card for all: its model names them all, so that changing one of them changes the key of every question.
    fn card(&self) -> PlayerCard {
        let mut card = self.usual.card();
        for (phase, player) in &self.phases {
            card.model = format!("{}; {phase}: {}", card.model, player.card().model);
        }
        card
    }

    fn sees(&self) -> bool {
        self.usual.sees()
    }

    fn in_own_time(&self) -> bool {
        self.usual.in_own_time() || self.phases.values().any(|player| player.in_own_time())
    }

    async fn ask(&self, request: &VlmRequest) -> Result<VlmAnswer, RoleError> {
        self.for_name(&request.name).ask(request).await
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use harmony_roles::Usage;
    use serde_json::{Value, json};

    struct Named(&'static str);

    #[async_trait]
    impl VisionLanguage for Named {
        fn card(&self) -> PlayerCard {
            PlayerCard { player: "p".into(), model: self.0.into(), offline: false, concurrency: 3 }
        }

        async fn ask(&self, _: &VlmRequest) -> Result<VlmAnswer, RoleError> {
            Ok(VlmAnswer { value: json!(self.0), raw: String::new(), usage: Usage::default() })
        }
    }

    #[tokio::test]
    async fn the_phase_decides_who_answers() {
        let others: [(String, Arc<dyn VisionLanguage>); 1] = [("furniture".into(), Arc::new(Named("large")))];
        let player = PhasedVlm::new(Arc::new(Named("small")), others.into());
        let ask = async |name: &str| {
            let request = VlmRequest {
                name: name.into(),
                prompt: String::new(),
                pictures: vec![],
                schema: Value::Null,
                example: Value::Null,
                question: None,
            };
            player.ask(&request).await.unwrap().value
        };
        assert_eq!(ask("3_furniture/list").await, json!("large"));
        assert_eq!(ask("2_wall/list").await, json!("small"));
        assert_eq!(ask("furniture").await, json!("large"));
        assert_eq!(player.card().model, "small; furniture: large");
        assert_eq!(player.card().concurrency, 3);
    }
}
