//! The scene in 3D: GLB and viewer inside the page.

use std::fmt::Write;
use std::path::Path;

use crate::pictures::base64;

/// Larger files would make the page too heavy to open, bytes.
const MAX_GLB: u64 = 96 << 20;
/// The bundle of three.js and our viewer, made by `tools/build_viewer.sh`.
const VIEWER: &str = include_str!("../../assets/viewer.js");

/// The section, and the scripts for the page's end.
pub(crate) fn view3d(run: &Path) -> (String, String) {
    let mut out = "<h2 id=\"scene3d\">The scene in 3D</h2>".to_owned();
    let file = run.join("scene_full.glb");
    let bytes = match harmony_io::read_bounded(&file, MAX_GLB) {
        Ok(bytes) => bytes,
        Err(harmony_io::FileError::TooLarge { bytes, .. }) => {
            let _ = write!(
                out,
                "<p class=\"soft\">scene_full.glb has {} MB, too much for this page: open it in a 3D program.</p>",
                bytes >> 20
            );
            return (out, String::new());
        }
        Err(_) => {
            out.push_str("<p class=\"soft\">There is no scene_full.glb in this run.</p>");
            return (out, String::new());
        }
    };
    let _ = write!(
        out,
        "<div class=\"card\"><div class=\"bar\"><button type=\"button\" id=\"view3d-start\">Start the 3D view ({} \
         MB)</button><span class=\"bar\" id=\"view3d-bar\" style=\"margin:0\" hidden><button type=\"button\" \
         data-view=\"corner\">From outside</button><button type=\"button\" data-view=\"photo\">Photo's camera</button>\
         <button type=\"button\" data-view=\"top\">From above</button><select id=\"view3d-light\" aria-label=\"Light\">\
         <option value=\"even\">Even light</option><option value=\"scene\">The scene's lights, no shadows</option></select>\
         <label><input type=\"checkbox\" id=\"view3d-room\" checked> room</label></span><span class=\"soft\" id=\"picked\">\
         </span></div><div id=\"view3d\"><span class=\"soft\">Drag to turn, wheel to come closer, click an \
         object.</span></div></div>",
        (bytes.len() as f64 / 1e6).max(0.1).round().max(1.0)
    );
    let scripts =
        format!("<script type=\"text/plain\" id=\"glb\">{}</script><script>{VIEWER}</script>", base64(&bytes));
    (out, scripts)
}
