//! `multipart/form-data`, read.

/// A part of a form.
pub struct Field<'a> {
    /// Name of the field.
    pub name: String,
    /// Content.
    pub content: &'a [u8],
}

/// The boundary of a form's content type.
pub fn boundary(content_type: &str) -> Option<&str> {
    let rest = content_type.strip_prefix("multipart/form-data")?;
    Some(rest.split_once("boundary=")?.1.trim_matches('"'))
}

/// The parts of a form.
pub fn parts<'a>(body: &'a [u8], boundary: &str) -> Vec<Field<'a>> {
    let mark = format!("--{boundary}");
    let starts = find_all(body, mark.as_bytes());
    let mut fields = Vec::new();
    for pair in starts.windows(2) {
        let part = &body[pair[0] + mark.len()..pair[1]];
        let Some(end) = part.windows(4).position(|w| w == b"\r\n\r\n") else { continue };
        let head = String::from_utf8_lossy(&part[..end]);
        let name = head.split("name=\"").nth(1).and_then(|rest| rest.split('"').next()).unwrap_or_default();
        let content = part[end + 4..].strip_suffix(b"\r\n").unwrap_or(&part[end + 4..]);
        fields.push(Field { name: name.to_owned(), content });
    }
    fields
}

fn find_all(body: &[u8], mark: &[u8]) -> Vec<usize> {
    let mut found = Vec::new();
    let mut at = 0;
    while at + mark.len() <= body.len() {
        match body[at..].iter().position(|b| *b == mark[0]) {
            Some(offset) => {
                at += offset;
                if body[at..].starts_with(mark) {
                    found.push(at);
                    at += mark.len();
                } else {
                    at += 1;
                }
            }
            None => break,
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use harmony_players::http::multipart::{Field as Sent, encode};

    #[test]
    fn what_the_program_sends_is_read() {
        let fields =
            [Sent::text("prompt", "Empty it.\r\nNow."), Sent::png("image[]", "image.png", vec![0, 13, 10, 45, 45])];
        let (kind, body) = encode(&fields);
        let read = parts(&body, boundary(&kind).unwrap());
        let read: Vec<(&str, &[u8])> = read.iter().map(|f| (f.name.as_str(), f.content)).collect();
        assert_eq!(read, [("prompt", &b"Empty it.\r\nNow."[..]), ("image[]", &[0, 13, 10, 45, 45][..])]);
    }
}
