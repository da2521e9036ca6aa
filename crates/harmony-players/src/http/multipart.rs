//! A form with files (RFC 7578), as OpenAI's image routes and those who copy them want it.

use std::fmt::Write as _;

/// One field of a form.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Field {
    /// Name.
    pub name: &'static str,
    /// File name and media type, for a file.
    pub file: Option<(&'static str, &'static str)>,
    /// Content.
    pub content: Vec<u8>,
}

impl Field {
    /// A text.
    pub fn text(name: &'static str, text: impl Into<String>) -> Self {
        Self { name, file: None, content: text.into().into_bytes() }
    }

    /// A PNG file.
    pub fn png(name: &'static str, file: &'static str, bytes: Vec<u8>) -> Self {
        Self { name, file: Some((file, "image/png")), content: bytes }
    }
}

/// The form's content type and body. The boundary is a hash of the content, so that the same form gives the same bytes.
pub fn encode(fields: &[Field]) -> (String, Vec<u8>) {
    let mut hasher = blake3::Hasher::new();
    for field in fields {
        hasher.update(field.name.as_bytes());
        hasher.update(&(field.content.len() as u64).to_le_bytes());
        hasher.update(&field.content);
    }
    let boundary = format!("harmony-{}", &hasher.finalize().to_hex()[..32]);
    let mut body = Vec::new();
    for field in fields {
        let mut head = format!("--{boundary}\r\nContent-Disposition: form-data; name=\"{}\"", field.name);
        if let Some((name, media)) = field.file {
            // Writing to a string does not fail.
            let _ = write!(head, "; filename=\"{name}\"\r\nContent-Type: {media}");
        }
        body.extend_from_slice(head.as_bytes());
        body.extend_from_slice(b"\r\n\r\n");
        body.extend_from_slice(&field.content);
        body.extend_from_slice(b"\r\n");
    }
    body.extend_from_slice(format!("--{boundary}--\r\n").as_bytes());
    (format!("multipart/form-data; boundary={boundary}"), body)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_form_is_framed_by_its_boundary() {
        let fields = [Field::text("prompt", "a grün sofa"), Field::png("image[]", "image.png", vec![1, 13, 10, 2])];
        let (content_type, body) = encode(&fields);
        let boundary = content_type.strip_prefix("multipart/form-data; boundary=").unwrap();
        let want = [
            format!("--{boundary}\r\nContent-Disposition: form-data; name=\"prompt\"\r\n\r\n").as_bytes(),
            "a grün sofa\r\n".as_bytes(),
            format!("--{boundary}\r\nContent-Disposition: form-data; name=\"image[]\"; filename=\"image.png\"\r\n")
                .as_bytes(),
            b"Content-Type: image/png\r\n\r\n\x01\x0d\x0a\x02\r\n",
            format!("--{boundary}--\r\n").as_bytes(),
        ]
        .concat();
        assert_eq!(body, want);
        assert_eq!(encode(&fields), (content_type, body));
    }
}
