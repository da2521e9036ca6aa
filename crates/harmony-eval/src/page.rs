//! What the pages of this crate share: text, style, pictures inside the page.

use std::path::Path;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use harmony_io::picture;
use harmony_scene::ImageSize;
use image::RgbImage;
use image::imageops::FilterType;

/// Longest side of a picture in a page, pixels.
const LONGEST: u32 = 560;
/// Quality of its JPEG.
const QUALITY: u8 = 82;

/// What a page allows itself: nothing from elsewhere, no scripts.
const POLICY: &str =
    "default-src 'none'; img-src data:; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'";

const STYLE: &str = "\
:root{color-scheme:light dark;--ink:#1d2126;--soft:#69727d;--line:#dfe3e8;--paper:#fff;--panel:#f6f7f9;--bad:#b3261e;\
--good:#177245}@media(prefers-color-scheme:dark){:root{--ink:#e6e8eb;--soft:#9aa3ad;--line:#383e46;--paper:#16191d;\
--panel:#1f2328;--bad:#f2857c;--good:#6cc79a}}body{font:15px/1.5 system-ui,sans-serif;color:var(--ink);\
background:var(--paper);max-width:1280px;margin:2rem auto;padding:0 1rem}h1{font-size:1.5rem;margin-bottom:.2rem}\
h2{font-size:1.15rem;margin-top:2.2rem}h3{font-size:1rem;margin:1.4rem 0 .3rem}p{margin:.3rem 0}.soft,small{\
color:var(--soft)}.wide{overflow-x:auto}table{border-collapse:collapse;font-variant-numeric:tabular-nums;\
font-size:.87rem}th,td{padding:.2rem .6rem;text-align:right;border-bottom:1px solid var(--line);white-space:nowrap}\
th{color:var(--soft);font-weight:600}th:first-child,td:first-child{text-align:left}.bad{color:var(--bad)}\
.good{color:var(--good)}.row{display:grid;grid-template-columns:repeat(auto-fit,minmax(240px,1fr));gap:.6rem}\
figure{margin:0;padding:.5rem;background:var(--panel);border-radius:6px}figure img{width:100%;height:auto;\
display:block;border-radius:4px}figcaption{font-size:.85rem;font-variant-numeric:tabular-nums}";

/// Text as HTML text.
pub(crate) fn esc(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// A page around its content.
pub(crate) fn page(title: &str, content: &str) -> String {
    format!(
        "<!doctype html><html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"viewport\" \
         content=\"width=device-width\"><meta http-equiv=\"Content-Security-Policy\" content=\"{POLICY}\"><title>{}\
         </title><style>{STYLE}</style></head><body>{content}</body></html>\n",
        esc(title)
    )
}

/// A picture file as a small JPEG inside the page; a sentence where it cannot be read.
pub(crate) fn picture_of(path: &Path, alt: &str) -> String {
    // A photo stands upright by its EXIF tag; renders have none.
    let image = harmony_io::load_photo(path).map(|p| p.image).map_err(|e| e.to_string());
    match image.or_else(|_| picture::read(path).map(image::DynamicImage::into_rgb8).map_err(|e| e.to_string())) {
        Ok(image) => embedded(&image, alt),
        Err(reason) => format!("<p class=\"bad\">{}</p>", esc(&reason)),
    }
}

/// A picture inside the page.
pub(crate) fn embedded(image: &RgbImage, alt: &str) -> String {
    let size = ImageSize::new(image.width(), image.height()).fit_within(LONGEST);
    let small = image::imageops::resize(image, size.width, size.height, FilterType::Triangle);
    match picture::rgb_jpeg(&small, QUALITY) {
        Ok(bytes) => format!(
            "<img width=\"{}\" height=\"{}\" alt=\"{}\" src=\"data:image/jpeg;base64,{}\">",
            size.width,
            size.height,
            esc(alt),
            STANDARD.encode(bytes)
        ),
        Err(reason) => format!("<p class=\"bad\">{}</p>", esc(&reason.to_string())),
    }
}
