//! What an answer that is not a success means, whoever gave it.

use harmony_calls::shortened;
use harmony_roles::RoleError;
use serde_json::Value;

use super::HttpAnswer;
use super::wait::retry_after;

/// Longest part of a body that an error keeps, characters.
pub const MAX_RAW: usize = 600;

/// Codes of OpenAI (and of those who copy it) for an account that is used up: waiting does not help.
const SPENT: [&str; 7] = [
    "insufficient_quota",
    "credit_balance_exhausted",
    "billing_hard_limit_reached",
    "billing_not_active",
    "spend_limit_reached",
    "usage_limit_reached",
    "quota_exceeded",
];

/// Codes for a request that was declined for what it asks.
const DECLINED: [&str; 6] = [
    "moderation_blocked",
    "content_policy_violation",
    "content_filter",
    "image_generation_user_error_policy",
    "safety_violation",
    "responsible_ai_policy_violation",
];

/// Words of services that say with status 400 or 403 what others say with 402.
const SPENT_WORDS: [&str; 7] = [
    "exhausted balance",
    "credit balance is too low",
    "reason: top_up",
    "more credits",
    "insufficient credit",
    "insufficient balance",
    "out of credit",
];

/// Words of a service that is not offered where its user is.
const REGION_WORDS: [&str; 5] =
    ["your region", "your country", "country, region", "unsupported_country", "location is not supported"];

/// Words for a key that is none, of a service that says so with status 400 (Gemini).
const KEY_WORDS: [&str; 2] = ["api key not valid", "api key expired"];

/// What a failed answer says, read from the many forms that services have.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Complaint {
    /// In words.
    pub message: String,
    /// Machine-readable codes and types, in small letters.
    pub codes: Vec<String>,
}

/// Reads what a failed answer says: `{"error": {"message", "type", "code", "status"}}`, `{"error": "..."}`,
/// `{"object": "error", "message"}`, `{"detail": ...}`, `{"text": ...}`, a list of one of these, or plain text.
pub fn complaint(answer: &HttpAnswer) -> Complaint {
    let text = answer.text();
    let value: Value = serde_json::from_str(&text).unwrap_or(Value::Null);
    let value = value.get(0).unwrap_or(&value);
    let inner = value.get("error").filter(|error| error.is_object()).unwrap_or(value);
    let message = ["message", "error", "detail", "text", "reason"]
        .iter()
        .find_map(|key| inner.get(key).filter(|v| !v.is_null()))
        .map_or_else(|| if value.is_null() { text.clone() } else { value.to_string() }, words);
    // Validation errors are lists of complaints, each with a type of its own.
    let listed = value.get("detail").and_then(Value::as_array).into_iter().flatten();
    let codes = ["code", "type", "status"]
        .iter()
        .filter_map(|key| inner.get(key)?.as_str())
        .chain(listed.filter_map(|one| one.get("type")?.as_str()))
        .map(str::to_ascii_lowercase)
        .collect();
    Complaint { message: shortened(message.trim(), MAX_RAW), codes }
}

/// A message that is a text as it is, and anything else as JSON (validation errors are lists).
fn words(value: &Value) -> String {
    value.as_str().map_or_else(|| value.to_string(), str::to_owned)
}

/// The role error of an answer whose status is not a success.
///
/// | status | meaning | error |
/// |---|---|---|
/// | 3xx | a redirect: never followed, the key might travel | `NotSetUp` |
/// | 400, 422 and others of 4xx | the request is not understood | `NotSetUp`; `Refused` for reasons of policy |
/// | 401, 403, and 400 in words for it | the key is not accepted, the account is used up, the region is blocked | `NotSetUp` |
/// | 402 and some 429 | the account is used up | `NotSetUp` |
/// | 404 | no such model or path | `NotSetUp` |
/// | 413 | too large | `NotCapable` |
/// | 451 | declined | `Refused` |
/// | 408, 409, 425, 429, 499, 5xx | passing | `Unavailable`, with the wait it asked for |
///
/// `remedy` is the hint for what cannot pass by itself.
pub fn failure(player: &str, answer: &HttpAnswer, remedy: &str) -> RoleError {
    let complaint = complaint(answer);
    let status = answer.status;
    let body: Value = serde_json::from_slice(&answer.body).unwrap_or(Value::Null);
    let player = player.to_owned();
    let said = if complaint.message.is_empty() { "nothing more".to_owned() } else { complaint.message.clone() };
    let not_set_up = |reason: String, hint: &str| RoleError::NotSetUp {
        player: player.clone(),
        reason,
        hint: if hint.is_empty() { remedy.to_owned() } else { hint.to_owned() },
    };
    let small = said.to_lowercase();
    let said_any = |list: &[&str]| list.iter().any(|words| small.contains(words));
    let has = |list: &[&str]| complaint.codes.iter().any(|code| list.contains(&code.as_str()));
    if status == 451 || (status < 500 && has(&DECLINED)) {
        return RoleError::Refused { player, reason: said };
    }
    match status {
        300..=399 => {
            let to = answer.header("location").map_or("elsewhere", |location| location);
            let to = shortened(to.split(['?', '#']).next().unwrap_or_default(), 200);
            not_set_up(
                format!("the address redirects (status {status}) to {to}; redirects are not followed"),
                "put the final address into the configuration, if you trust it",
            )
        }
        402 => not_set_up(format!("the account is used up (status 402): {said}"), "top up the account"),
        429 if has(&SPENT) || daily_quota(&body) => not_set_up(
            format!("the account or its quota is used up (status 429): {said}"),
            "top up the account or wait for the quota to be renewed; waiting a moment does not help",
        ),
        408 | 409 | 425 | 429 | 499 | 500..=599 => RoleError::Unavailable {
            player,
            reason: format!("status {status}: {said}"),
            status: Some(status),
            retry_after: retry_after(answer, &body),
        },
        400 | 401 | 403 if said_any(&SPENT_WORDS) => {
            not_set_up(format!("the account is used up (status {status}): {said}"), "top up the account")
        }
        400 | 401 | 403 if said_any(&REGION_WORDS) || has(&REGION_WORDS) => not_set_up(
            format!("it is not offered where you are (status {status}): {said}"),
            "take a service that is offered in your country; another key does not help",
        ),
        400 if said_any(&KEY_WORDS) => not_set_up(format!("it did not accept the key (status 400): {said}"), ""),
        401 | 403 => not_set_up(format!("it did not accept the key (status {status}): {said}"), ""),
        404 => not_set_up(format!("no such model or address (status 404): {said}"), ""),
        413 => RoleError::NotCapable { player, reason: format!("the request is too large (status 413): {said}") },
        _ => not_set_up(format!("it did not accept the request (status {status}): {said}"), ""),
    }
}

/// Whether Gemini's details speak of a quota by the day: it is not renewed within the run.
fn daily_quota(body: &Value) -> bool {
    let details = body.pointer("/error/details").and_then(Value::as_array);
    let violations = details.into_iter().flatten().filter_map(|detail| detail.get("violations")?.as_array()).flatten();
    violations.filter_map(|violation| violation.get("quotaId")?.as_str()).any(|id| id.contains("PerDay"))
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;
    use serde_json::json;

    fn answer(status: u16, body: &str) -> HttpAnswer {
        HttpAnswer { status, headers: vec![], body: body.as_bytes().to_vec() }
    }

    fn error(status: u16, body: &Value) -> RoleError {
        failure("somebody", &answer(status, &body.to_string()), "do this")
    }

    #[test]
    fn messages_are_found_in_all_their_forms() {
        for body in [
            r#"{"error":{"message":"no luck","type":"t"}}"#,
            r#"{"error":"no luck"}"#,
            r#"{"object":"error","message":"no luck","code":400}"#,
            r#"{"detail":"no luck"}"#,
            r#"{"text":"no luck","error_code":1}"#,
            r#"[{"error":{"message":"no luck"}}]"#,
            "no luck\n",
        ] {
            assert_eq!(complaint(&answer(400, body)).message, "no luck", "{body}");
        }
        let list = complaint(&answer(422, r#"{"detail":[{"loc":["body","steps"],"msg":"too many"}]}"#)).message;
        assert!(list.contains("steps") && list.contains("too many"));
        assert!(complaint(&answer(500, &"x".repeat(100_000))).message.len() <= MAX_RAW);
        assert_eq!(complaint(&answer(500, "")).message, "");
    }

    #[test]
    fn passing_failures_are_told_from_lasting_ones() {
        let openai = |code: &str| json!({"error": {"message": "m", "type": "t", "code": code}});
        for (status, body, retryable) in [
            (429, openai("rate_limit_exceeded"), true),
            (429, openai("slow_down"), true),
            (429, openai("insufficient_quota"), false),
            (429, openai("credit_balance_exhausted"), false),
            (503, openai("server_is_overloaded"), true),
            (529, json!({"type": "error", "error": {"type": "overloaded_error", "message": "m"}}), true),
            (500, json!({}), true),
            (502, json!(null), true),
            (408, json!({}), true),
            (400, openai("unsupported_parameter"), false),
            (401, openai("invalid_api_key"), false),
            (402, json!({"error": {"code": 402, "status": "RESOURCE_EXHAUSTED", "message": "m"}}), false),
            (404, json!({}), false),
            (413, json!({}), false),
            (307, json!({}), false),
        ] {
            let error = error(status, &body);
            assert_eq!(error.is_retryable(), retryable, "{status} {body}: {error}");
            if retryable {
                assert_eq!(error.status(), Some(status));
            }
        }
    }

    #[test]
    fn a_daily_quota_is_not_waited_for_and_a_minute_is() {
        let gemini = |id: &str| {
            json!({"error": {"code": 429, "status": "RESOURCE_EXHAUSTED", "message": "m", "details": [
                {"@type": "type.googleapis.com/google.rpc.QuotaFailure", "violations": [{"quotaId": id}]},
                {"@type": "type.googleapis.com/google.rpc.RetryInfo", "retryDelay": "12s"}]}})
        };
        assert!(!error(429, &gemini("GenerateRequestsPerDayPerProjectPerModel")).is_retryable());
        let minute = error(429, &gemini("GenerateRequestsPerMinutePerProjectPerModel"));
        assert_eq!(minute.retry_after(), Some(Duration::from_secs(12)));
    }

    #[test]
    fn a_spent_account_a_blocked_region_and_a_wrong_key_are_told_apart() {
        let hint = |body: &Value| {
            let error = error(403, body);
            assert!(matches!(error, RoleError::NotSetUp { .. }));
            (error.to_string(), error.hint().unwrap_or_default().to_owned())
        };
        let (said, todo) = hint(&json!({"detail": "User is locked. Reason: Exhausted balance. Top up your balance."}));
        assert!(said.contains("used up") && todo.contains("top up"), "{said} {todo}");
        let (said, todo) = hint(&json!({"error": {"code": "unsupported_country_region_territory",
            "message": "Country, region, or territory not supported"}}));
        assert!(said.contains("where you are") && todo.contains("another key does not help"), "{said} {todo}");
        // Gemini and Anthropic say these things with status 400.
        for (text, what) in [
            ("API key not valid. Please pass a valid API key.", "did not accept the key"),
            ("User location is not supported for the API use.", "not offered where you are"),
            ("Your credit balance is too low to access the Anthropic API.", "account is used up"),
            ("messages: at least one message is required", "did not accept the request"),
        ] {
            let said = error(400, &json!({"error": {"code": 400, "message": text}})).to_string();
            assert!(said.contains(what), "{said}");
        }
        let (said, todo) = hint(&json!({"detail": "Invalid key"}));
        assert!(said.contains("did not accept the key") && todo == "do this", "{said} {todo}");
        let policy =
            json!({"detail": [{"loc": ["body", "image_url"], "msg": "no", "type": "content_policy_violation"}]});
        assert!(matches!(error(422, &policy), RoleError::Refused { .. }));
    }

    #[test]
    fn policy_is_a_refusal_and_a_redirect_shows_no_query() {
        let blocked = json!({"error": {"code": "moderation_blocked", "message": "no"}});
        assert!(matches!(error(400, &blocked), RoleError::Refused { .. }));
        assert!(matches!(error(451, &json!({})), RoleError::Refused { .. }));
        let mut moved = answer(302, "");
        moved.headers.push(("location".into(), "https://elsewhere.example/x?token=abc".into()));
        let error = failure("somebody", &moved, "").to_string();
        assert!(error.contains("elsewhere.example") && !error.contains("abc"), "{error}");
    }
}
