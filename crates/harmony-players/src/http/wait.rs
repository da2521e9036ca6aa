//! How long a service asks to wait: `Retry-After` in seconds or as a date, and the vendors' own headers and details.

use std::time::{Duration, SystemTime, UNIX_EPOCH};

use serde_json::Value;

use super::HttpAnswer;

/// The longest wait that is believed; a date further away is a mistake of somebody's clock.
const LONGEST: Duration = Duration::from_hours(24);

/// How long to wait before the same request may succeed, when the answer says so.
///
/// Read in this order: `retry-after-ms`; `retry-after` (seconds or a date); Gemini's `RetryInfo` in the body; the
/// resets of OpenAI's and Anthropic's limits, of those that are used up.
pub fn retry_after(answer: &HttpAnswer, body: &Value) -> Option<Duration> {
    let now = told_now(answer);
    let millis = answer.header("retry-after-ms").and_then(|text| positive(text.trim().parse().ok()?));
    let found = millis
        .map(|ms| ms / 1000.0)
        .and_then(seconds)
        .or_else(|| answer.header("retry-after").and_then(|text| delay(text, now)))
        .or_else(|| retry_info(body))
        .or_else(|| used_up(answer));
    found.filter(|wait| *wait <= LONGEST)
}

/// Seconds, or a date.
fn delay(text: &str, now: SystemTime) -> Option<Duration> {
    match text.trim().parse::<f64>() {
        Ok(value) => seconds(positive(value)?),
        Err(_) => Some(http_date(text)?.duration_since(now).unwrap_or_default()),
    }
}

fn positive(value: f64) -> Option<f64> {
    (value.is_finite() && value >= 0.0).then_some(value)
}

fn seconds(value: f64) -> Option<Duration> {
    Duration::try_from_secs_f64(value).ok()
}

/// `error.details[].retryDelay` of type `RetryInfo`, such as `12s`.
fn retry_info(body: &Value) -> Option<Duration> {
    let details = body.pointer("/error/details")?.as_array()?;
    details.iter().find_map(|detail| spelled(detail.get("retryDelay")?.as_str()?))
}

/// The service's clock, else ours.
fn told_now(answer: &HttpAnswer) -> SystemTime {
    answer.header("date").and_then(http_date).unwrap_or_else(SystemTime::now)
}

/// The latest reset of the limits of which nothing remains; answers of any status tell of them.
pub fn used_up(answer: &HttpAnswer) -> Option<Duration> {
    let now = told_now(answer);
    let openai = ["requests", "tokens"].map(|what| {
        let remaining = answer.header(&format!("x-ratelimit-remaining-{what}"))?;
        let reset = answer.header(&format!("x-ratelimit-reset-{what}"))?;
        (remaining.trim() == "0").then(|| spelled(reset))?
    });
    let anthropic = ["requests", "tokens", "input-tokens", "output-tokens"].map(|what| {
        let remaining = answer.header(&format!("anthropic-ratelimit-{what}-remaining"))?;
        let reset = answer.header(&format!("anthropic-ratelimit-{what}-reset"))?;
        (remaining.trim() == "0").then(|| Some(rfc3339(reset)?.duration_since(now).unwrap_or_default()))?
    });
    openai.into_iter().chain(anthropic).flatten().max()
}

/// A duration as OpenAI and Google spell it: `20ms`, `1s`, `6m0s`, `1h2m3.5s`.
pub fn spelled(text: &str) -> Option<Duration> {
    let mut rest = text.trim();
    if rest.is_empty() {
        return None;
    }
    let mut total = 0.0;
    while !rest.is_empty() {
        let digits = rest.find(|c: char| !(c.is_ascii_digit() || c == '.'))?;
        let value: f64 = rest[..digits].parse().ok()?;
        rest = &rest[digits..];
        let unit = rest.find(|c: char| c.is_ascii_digit()).unwrap_or(rest.len());
        total += value
            * match &rest[..unit] {
                "ms" => 1e-3,
                "s" => 1.0,
                "m" => 60.0,
                "h" => 3600.0,
                "d" => 86_400.0,
                _ => return None,
            };
        rest = &rest[unit..];
    }
    seconds(positive(total)?)
}

/// A date as HTTP writes it today: `Sun, 06 Nov 1994 08:49:37 GMT`.
pub fn http_date(text: &str) -> Option<SystemTime> {
    const MONTHS: [&str; 12] = ["Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec"];
    let (_, rest) = text.trim().split_once(", ")?;
    let mut parts = rest.split(' ');
    let day = parts.next()?.parse().ok()?;
    let month = parts.next()?;
    let month = MONTHS.iter().position(|m| *m == month)? as u64 + 1;
    let year = parts.next()?.parse().ok()?;
    let time = parts.next()?;
    if parts.next()? != "GMT" {
        return None;
    }
    moment(year, month, day, time, 0)
}

/// A moment such as `2026-11-21T10:00:30Z` or `...30.5+01:00`.
pub fn rfc3339(text: &str) -> Option<SystemTime> {
    let (date, time) = text.trim().split_once(['T', 't', ' '])?;
    let mut date = date.split('-');
    let (year, month, day) = (date.next()?.parse().ok()?, date.next()?.parse().ok()?, date.next()?.parse().ok()?);
    let at = time.find(['Z', 'z', '+', '-'])?;
    let (time, zone) = time.split_at(at);
    let offset = match zone.as_bytes().first()? {
        b'Z' | b'z' => 0,
        sign => {
            let (hours, minutes) = zone[1..].split_once(':')?;
            let minutes = hours.parse::<i64>().ok()? * 60 + minutes.parse::<i64>().ok()?;
            if *sign == b'-' { -minutes } else { minutes }
        }
    };
    let time = time.split('.').next()?;
    moment(year, month, day, time, offset)
}

/// A moment of the calendar; `time` is `hh:mm:ss`, `offset` minutes east of Greenwich.
fn moment(year: u64, month: u64, day: u64, time: &str, offset: i64) -> Option<SystemTime> {
    let mut clock = time.split(':').map(|part| part.parse::<u64>().ok());
    let (h, m, s) = (clock.next()??, clock.next()??, clock.next()??);
    if !((1970..=9999).contains(&year) && (1..=12).contains(&month) && (1..=31).contains(&day)) {
        return None;
    }
    if h > 23 || m > 59 || s > 60 || offset.abs() > 24 * 60 {
        return None;
    }
    // Days from a civil date: years begin in March, so that the leap day comes last.
    let (y, shifted) = if month > 2 { (year, month - 3) } else { (year - 1, month + 9) };
    let days = 365 * y + y / 4 - y / 100 + y / 400 + (153 * shifted + 2) / 5 + day - 1 - 719_468;
    let seconds = (days * 86_400 + h * 3600 + m * 60 + s) as i64 - offset * 60;
    Some(UNIX_EPOCH + Duration::from_secs(u64::try_from(seconds).ok()?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn answer(headers: &[(&str, &str)]) -> HttpAnswer {
        HttpAnswer {
            status: 429,
            headers: headers.iter().map(|(k, v)| ((*k).to_owned(), (*v).to_owned())).collect(),
            body: vec![],
        }
    }

    fn wait(headers: &[(&str, &str)]) -> Option<f64> {
        retry_after(&answer(headers), &Value::Null).map(|d| d.as_secs_f64())
    }

    #[test]
    fn dates_are_read() {
        let seconds = |t: Option<SystemTime>| t.unwrap().duration_since(UNIX_EPOCH).unwrap().as_secs();
        // The example of RFC 9110, and `date -u -d @...` for the others.
        assert_eq!(seconds(http_date("Sun, 06 Nov 1994 08:49:37 GMT")), 784_111_777);
        assert_eq!(seconds(http_date("Thu, 29 Feb 2024 23:59:59 GMT")), 1_709_251_199);
        assert_eq!(seconds(rfc3339("2026-11-21T10:00:30Z")), 1_795_255_230);
        assert_eq!(seconds(rfc3339("2026-11-21T11:00:30.25+01:00")), 1_795_255_230);
        for broken in ["", "soon", "Sun, 06 Nov 1994", "Sun, 99 Nov 1994 08:49:37 GMT", "Sun, 06 Nov 1994 8h GMT"] {
            assert_eq!(http_date(broken), None, "{broken}");
        }
        assert_eq!(rfc3339("2026-11-21"), None);
    }

    #[test]
    fn every_way_to_ask_for_patience_is_understood() {
        assert_eq!(wait(&[("retry-after", "7")]), Some(7.0));
        assert_eq!(wait(&[("retry-after", "0.5")]), Some(0.5));
        assert_eq!(wait(&[("retry-after-ms", "250"), ("retry-after", "1")]), Some(0.25));
        let date = ("date", "Sun, 06 Nov 1994 08:49:37 GMT");
        assert_eq!(wait(&[date, ("retry-after", "Sun, 06 Nov 1994 08:50:07 GMT")]), Some(30.0));
        assert_eq!(wait(&[date, ("retry-after", "Sun, 06 Nov 1994 08:00:00 GMT")]), Some(0.0), "past: at once");
        assert_eq!(wait(&[("retry-after", "-3")]), None);
        assert_eq!(wait(&[("retry-after", "1e300")]), None);
        assert_eq!(wait(&[]), None);
        let reset = ("x-ratelimit-reset-tokens", "6m0s");
        assert_eq!(wait(&[("x-ratelimit-remaining-tokens", "0"), reset]), Some(360.0));
        assert_eq!(wait(&[("x-ratelimit-remaining-tokens", "12"), reset]), None, "this limit is not the one");
        let anthropic = ("anthropic-ratelimit-input-tokens-reset", "1994-11-06T08:49:52Z");
        assert_eq!(wait(&[date, ("anthropic-ratelimit-input-tokens-remaining", "0"), anthropic]), Some(15.0));
        let body =
            json!({"error": {"details": [{"@type": "x/QuotaFailure"}, {"@type": "x/RetryInfo", "retryDelay": "12s"}]}});
        assert_eq!(retry_after(&answer(&[]), &body), Some(Duration::from_secs(12)));
    }

    #[test]
    fn spelled_durations_are_read() {
        let of = |text| spelled(text).map(|d| d.as_millis());
        assert_eq!(of("20ms"), Some(20));
        assert_eq!(of("1s"), Some(1000));
        assert_eq!(of("6m0s"), Some(360_000));
        assert_eq!(of("1h2m3.5s"), Some(3_723_500));
        for broken in ["", "s", "1x", "1.2.3s", "12", "-1s"] {
            assert_eq!(of(broken), None, "{broken}");
        }
    }
}
