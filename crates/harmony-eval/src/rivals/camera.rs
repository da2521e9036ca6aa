//! Cameras beside a scene, in the forms that programs leave.
//!
//! | form | fields |
//! |---|---|
//! | ours (`camera.json`) | `width`, `height`, `K`, `R`, `t` (OpenCV axes, rows) |
//! | the paper's release (`camera_vggt.json`) | `position_m`, `look_at_m`, `up`, `width_px`, `height_px`, `hfov_deg` |
//! | its scripts' sidecar (`<scene>_cam.json`) | `camera_pos`, `camera_rotation_euler_xyz_deg`, `fov` (horizontal, radians), `width`, `height` |

use std::path::Path;

use glam::{DMat3, DVec3};
use harmony_scene::{Camera, ImageSize, Intrinsics};
use serde_json::Value;

use super::RivalError;

/// `camera_from_world` of a camera with glTF's axes (it looks along -z): its OpenCV axes.
pub const FLIP: DMat3 = DMat3::from_cols(DVec3::X, DVec3::NEG_Y, DVec3::NEG_Z);

/// Largest image size that a file may tell.
const MAX_SIDE: f64 = 32_768.0;

/// A camera at the origin of its own frame, glTF's axes.
pub fn at_origin(size: ImageSize, hfov: f64) -> Camera {
    with_lens(size, Intrinsics::from_horizontal_fov(size, hfov))
}

/// The same with a lens.
pub fn with_lens(size: ImageSize, intrinsics: Intrinsics) -> Camera {
    Camera { size, intrinsics, rotation: FLIP, translation: DVec3::ZERO }
}

/// A camera from its pose `world_from_camera` in glTF's axes.
pub fn posed(size: ImageSize, intrinsics: Intrinsics, turn: DMat3, centre: DVec3) -> Camera {
    let rotation = FLIP * turn.transpose();
    Camera { size, intrinsics, rotation, translation: -(rotation * centre) }
}

/// A camera that looks at a point.
pub fn looking_at(size: ImageSize, hfov: f64, centre: DVec3, at: DVec3, up: DVec3) -> Option<Camera> {
    let back = (centre - at).try_normalize()?;
    let right = up.cross(back).try_normalize()?;
    let turn = DMat3::from_cols(right, back.cross(right), back);
    Some(posed(size, Intrinsics::from_horizontal_fov(size, hfov), turn, centre))
}

/// The camera of a file beside the scene, in any of the forms; `size` where it tells none.
///
/// # Errors
/// [`RivalError`] when it is none of them.
pub fn sidecar(path: &Path, size: Option<ImageSize>) -> Result<Camera, RivalError> {
    let value: Value = harmony_io::read_json(path)?;
    let bad = |reason: &str| RivalError::Content { path: path.to_owned(), reason: reason.to_owned() };
    let side = |key: &str| value[key].as_f64().filter(|v| (1.0..=MAX_SIDE).contains(v)).map(|v| v as u32);
    let told = |w: &str, h: &str| Some(ImageSize::new(side(w)?, side(h)?));
    let size = told("width", "height").or_else(|| told("width_px", "height_px")).or(size);
    let size = size.ok_or_else(|| bad("it tells no image size"))?;
    let camera = ours(&value, size).or_else(|| release(&value, size)).or_else(|| euler(&value, size));
    let camera = camera.ok_or_else(|| bad("it has none of the known forms of a camera"))?;
    usable(&camera).then_some(camera).ok_or_else(|| bad("its camera is not finite, or has no field of view"))
}

/// Whether every number is one and the rotation is a rotation.
pub fn usable(camera: &Camera) -> bool {
    let k = &camera.intrinsics;
    let lens = k.fx > 0.0 && k.fy > 0.0 && [k.fx, k.fy, k.cx, k.cy].iter().all(|v| v.is_finite());
    let r = camera.rotation;
    let unit = (r * r.transpose() - DMat3::IDENTITY).to_cols_array().iter().all(|v| v.abs() < 1e-3);
    lens && unit && r.determinant() > 0.0 && camera.translation.is_finite()
}

/// Three numbers.
pub fn vec3(v: &Value) -> Option<DVec3> {
    Some(DVec3::new(v.get(0)?.as_f64()?, v.get(1)?.as_f64()?, v.get(2)?.as_f64()?))
}

/// A 3 x 3 matrix by rows.
pub fn mat3(v: &Value) -> Option<DMat3> {
    Some(DMat3::from_cols(vec3(v.get(0)?)?, vec3(v.get(1)?)?, vec3(v.get(2)?)?).transpose())
}

/// The lens of a matrix K.
pub fn lens(k: DMat3) -> Intrinsics {
    Intrinsics { fx: k.x_axis.x, fy: k.y_axis.y, cx: k.z_axis.x, cy: k.z_axis.y }
}

fn ours(v: &Value, size: ImageSize) -> Option<Camera> {
    Some(Camera { size, intrinsics: lens(mat3(&v["K"])?), rotation: mat3(&v["R"])?, translation: vec3(&v["t"])? })
}

fn release(v: &Value, size: ImageSize) -> Option<Camera> {
    let hfov = v["hfov_deg"].as_f64().filter(|d| (1.0..179.0).contains(d))?.to_radians();
    let up = vec3(&v["up"]).unwrap_or(DVec3::Y);
    looking_at(size, hfov, vec3(&v["position_m"])?, vec3(&v["look_at_m"])?, up)
}

/// Reading: the angles turn about the fixed axes x, then y, then z, as SciPy's lower-case `xyz` does.
fn euler(v: &Value, size: ImageSize) -> Option<Camera> {
    let hfov = v["fov"].as_f64().filter(|f| (0.02..3.1).contains(f))?;
    let angles = vec3(&v["camera_rotation_euler_xyz_deg"])?.map(f64::to_radians);
    let turn = euler_xyz(angles);
    Some(posed(size, Intrinsics::from_horizontal_fov(size, hfov), turn, vec3(&v["camera_pos"])?))
}

/// Turns about the fixed axes x, then y, then z: Blender's default order, too.
pub fn euler_xyz(angles: DVec3) -> DMat3 {
    DMat3::from_rotation_z(angles.z) * DMat3::from_rotation_y(angles.y) * DMat3::from_rotation_x(angles.x)
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn the_forms_of_one_camera_are_one_camera() {
        let size = ImageSize::new(640, 480);
        let (centre, pitch, hfov) = (DVec3::new(1.0, 1.5, 4.0), (-12.0_f64).to_radians(), 1.1);
        let forward = DVec3::new(0.0, pitch.sin(), -pitch.cos());
        let known = Camera::looking(size, Intrinsics::from_horizontal_fov(size, hfov), centre, forward);
        let at = centre + forward * 3.0;
        let r = known.rotation.transpose();
        let k = known.intrinsics;
        let forms = [
            format!(
                r#"{{"width":640,"height":480,"K":[[{},0,{}],[0,{},{}],[0,0,1]],"R":[{:?},{:?},{:?}],"t":{:?}}}"#,
                k.fx,
                k.cx,
                k.fy,
                k.cy,
                r.x_axis.to_array(),
                r.y_axis.to_array(),
                r.z_axis.to_array(),
                known.translation.to_array()
            ),
            format!(
                r#"{{"position_m":[1,1.5,4],"look_at_m":{:?},"width_px":640,"height_px":480,"hfov_deg":{}}}"#,
                at.to_array(),
                hfov.to_degrees()
            ),
            format!(
                r#"{{"camera_pos":[1,1.5,4],"camera_rotation_euler_xyz_deg":[-12,0,0],"fov":{hfov},"width":640,"height":480}}"#
            ),
        ];
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("camera.json");
        for form in &forms {
            fs::write(&path, form).unwrap();
            let found = sidecar(&path, None).unwrap();
            for p in [DVec3::new(0.3, 0.2, 1.0), DVec3::new(1.7, 2.1, -0.5)] {
                let off = found.project(p).unwrap() - known.project(p).unwrap();
                assert!(off.length() < 1e-6, "{form}: {off}");
            }
        }
        for broken in ["{}", r#"{"width":640,"height":480}"#, "[]", r#"{"width":1e9,"height":1}"#] {
            fs::write(&path, broken).unwrap();
            assert!(sidecar(&path, None).is_err(), "{broken}");
        }
        let mirrored = forms[0].replacen("\"R\":[[", "\"R\":[[-", 1);
        fs::write(&path, mirrored).unwrap();
        assert!(sidecar(&path, None).is_err(), "a camera that mirrors is none");
    }
}
