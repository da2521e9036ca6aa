//! The client against a server that misbehaves.
#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use std::time::{Duration, Instant};

use crate::loopback::{Loopback, Play, bytes, http, json};
use harmony_players::http::{ApiKey, Auth, Http, HttpLimits, HttpRequest, LocalHosts, Service, ServiceOptions};
use harmony_roles::RoleError;
use serde_json::json as value;

const CANARY: &str = "sk-canary-3f9a7c21b8e4d605";

fn key() -> Auth {
    Auth::Bearer(ApiKey::new("CANARY_KEY", CANARY).unwrap())
}

async fn failure(play: Play) -> RoleError {
    let server = Loopback::always(play).await;
    Service::new(&http(), server.service("/v1")).unwrap().call(&HttpRequest::get("/x")).await.unwrap_err()
}

#[tokio::test]
async fn a_limit_with_retry_after_says_when_to_come_again() {
    let body = value!({"error": {"message": "slow down", "code": "rate_limit_exceeded"}}).to_string();
    let error = failure(Play::Answer(429, vec![("Retry-After".into(), "7".into())], body.into_bytes())).await;
    assert!(error.is_retryable());
    assert_eq!((error.status(), error.retry_after()), (Some(429), Some(Duration::from_secs(7))));
    let error = failure(json(500, &value!({"error": "oops"}))).await;
    assert!(error.is_retryable() && error.to_string().contains("oops"), "{error}");
}

#[tokio::test]
async fn nobody_is_waited_for_without_end() {
    for (play, word) in [(Play::Silence, "within"), (Play::Stall(1000, b"abc".to_vec()), "stalled")] {
        let server = Loopback::always(play).await;
        let mut options = server.service("");
        options.limits.total = Duration::from_millis(900);
        let clock = Instant::now();
        let error = Service::new(&http(), options).unwrap().call(&HttpRequest::get("/x")).await.unwrap_err();
        assert!(clock.elapsed() < Duration::from_secs(5));
        assert!(error.is_retryable() && error.to_string().contains(word), "{error}");
    }
}

#[tokio::test]
async fn broken_connections_are_passing_failures() {
    for play in [Play::Close, Play::CutOff(1000, b"{\"half\":".to_vec())] {
        assert!(failure(play).await.is_retryable());
    }
    let gone = Loopback::always(Play::Close).await;
    let service = Service::new(&http(), gone.service("")).unwrap();
    drop(gone);
    tokio::time::sleep(Duration::from_millis(50)).await;
    let error = service.call(&HttpRequest::get("/x")).await.unwrap_err();
    assert!(error.is_retryable() && error.to_string().contains("no connection"), "{error}");
}

#[tokio::test]
async fn a_large_answer_is_refused_without_being_held() {
    let large = 200 << 20;
    let error = failure(Play::Stall(large, vec![0; 1000])).await;
    assert!(
        matches!(&error, RoleError::UnusableAnswer { complaint, .. } if complaint.contains("209715200")),
        "{error}"
    );

    let server = Loopback::always(Play::Endless).await;
    let mut options = server.service("");
    options.limits.answer_bytes = 1 << 20;
    let error = Service::new(&http(), options).unwrap().call(&HttpRequest::get("/x")).await.unwrap_err();
    assert!(matches!(error, RoleError::UnusableAnswer { .. }), "{error}");
    // What the sockets of both sides hold comes on top of the limit.
    assert!(server.sent.load(std::sync::atomic::Ordering::Relaxed) < 24 << 20);
}

#[tokio::test]
async fn redirects_are_not_followed() {
    let other = Loopback::always(json(200, &value!({}))).await;
    for status in [301, 302, 303, 307, 308] {
        let location = format!("http://localhost:{}/v1/x?{CANARY}", other.port);
        let server = Loopback::always(Play::Answer(status, vec![("location".into(), location)], vec![])).await;
        for auth in [Auth::None, key()] {
            let service = Service::new(&http(), server.service_with("/v1", auth)).unwrap();
            let request = HttpRequest::post_json("/x", &value!({"photo": "..."}));
            let error = service.call(&request).await.unwrap_err();
            assert!(matches!(error, RoleError::NotSetUp { .. }), "{error}");
            assert!(error.to_string().contains("redirect") && !error.to_string().contains("canary"), "{error}");
        }
    }
    assert!(other.seen().is_empty(), "{:?}", other.seen());
}

#[tokio::test]
async fn nothing_leaves_the_machine_with_local_only() {
    let server = Loopback::always(json(200, &value!({"here": true}))).await;
    let local = |named: &[&str]| {
        let named = named.iter().map(|name| (*name).to_owned()).collect();
        Http::new(Some(LocalHosts { named }), Duration::from_secs(2)).unwrap()
    };
    let at = |address: &str| ServiceOptions { address: address.into(), ..server.service("") };
    for address in ["https://api.openai.com/v1", "http://192.0.2.7:8081", "http://gpu-box:1", "http://0.0.0.0:1"] {
        let error = Service::new(&local(&["other-box"]), at(address)).unwrap_err();
        assert!(error.to_string().contains("local_only"), "{error}");
        assert!(error.hint().is_some());
    }
    for address in [format!("http://localhost:{}", server.port), server.address()] {
        let service = Service::new(&local(&[]), at(&address)).unwrap();
        assert!(service.call(&HttpRequest::get("/")).await.is_ok());
    }
    // A named host is looked up as usual, which must not be taken for a permission to reach others.
    let service = Service::new(&local(&["no-such-host.invalid"]), at("http://no-such-host.invalid:1")).unwrap();
    assert!(service.call(&HttpRequest::get("/")).await.is_err());
}

#[tokio::test]
async fn a_key_is_not_sent_in_the_clear_to_another_machine() {
    let server = Loopback::always(json(200, &value!({}))).await;
    let options = ServiceOptions { address: "http://example.org/v1".into(), ..server.service_with("", key()) };
    let error = Service::new(&http(), options).unwrap_err();
    assert!(error.to_string().contains("without encryption"), "{error}");
}

#[tokio::test]
async fn keys_travel_in_one_header_and_come_back_nowhere() {
    // A server that repeats all that it was sent.
    let server = Loopback::start(|seen| {
        let said = format!("{:?}", seen.headers);
        if seen.path.ends_with("/good") {
            bytes(said.into_bytes())
        } else {
            json(401, &value!({"error": {"message": said}}))
        }
    })
    .await;
    for (auth, header, want) in [
        (key(), "authorization", format!("Bearer {CANARY}")),
        (Auth::Header("x-api-key", ApiKey::new("K", CANARY).unwrap()), "x-api-key", CANARY.to_owned()),
    ] {
        let service = Service::new(&http(), server.service_with("/v1", auth)).unwrap();
        let error = service.call(&HttpRequest::get("/bad")).await.unwrap_err();
        assert!(!format!("{error} {error:?}").contains("canary"), "{error:?}");
        assert!(matches!(error, RoleError::NotSetUp { .. }));
        let answer = service.call(&HttpRequest::get("/good")).await.unwrap();
        assert!(answer.text().contains(header) && !answer.text().contains("canary"), "{}", answer.text());
        assert!(!format!("{service:?}").contains("canary"));
        assert_eq!(server.seen().last().unwrap().header(header), Some(want.as_str()));
    }
}

#[tokio::test]
async fn encryption_is_spoken_where_it_is_asked_for() {
    // A server that does not speak it: the handshake fails, in words, without a panic.
    let server = Loopback::always(json(200, &value!({}))).await;
    let address = format!("https://127.0.0.1:{}", server.port);
    let options = ServiceOptions {
        address,
        limits: HttpLimits { total: Duration::from_secs(3), ..HttpLimits::default() },
        ..server.service_with("", key())
    };
    let error = Service::new(&http(), options).unwrap().call(&HttpRequest::get("/")).await.unwrap_err();
    assert!(error.is_retryable(), "{error}");
    assert!(server.seen().is_empty());
}
