//! The text of a model's answer to each question: read as JSON, held against the schema, read into its type, checked,
//! and (lights, part models) applied.
#![no_main]

use harmony_calls::{parse_answer, schema_complaints};
use harmony_fuzz::{ids, questions};
use harmony_lighting::{LightingDelta, LightingSpec};
use harmony_prompts::{CompletedAnswer, FrontsAnswer, InspectAnswer, LayoutAnswer, ListAnswer, ReviewAnswer, parse};
use harmony_scene::{Extents, Light, LightKind, Lighting};
use libfuzzer_sys::fuzz_target;
use serde_json::Value;

fn lighting() -> Lighting {
    let light = |id: &str, kind| Light {
        id: id.into(),
        kind,
        position: [1.0, 2.0, 1.0],
        color: [1.0, 0.9, 0.8],
        intensity: 40.0,
        on: true,
        object: None,
    };
    Lighting {
        lights: vec![
            light("floor_lamp_01", LightKind::Point { radius_m: 0.05 }),
            light("sun", LightKind::Sun { direction: [0.0, -1.0, 0.0] }),
        ],
        ambient_color: [1.0; 3],
        ambient_intensity: 0.5,
        exposure: 0.0,
        view: harmony_scene::ViewTransform::Agx,
    }
}

fn finite(lighting: &Lighting) {
    let all = lighting.lights.iter().flat_map(|l| l.color.into_iter().chain(l.position).chain([l.intensity]));
    assert!(all.chain(lighting.ambient_color).chain([lighting.ambient_intensity]).all(f64::is_finite));
}

fn models(answer: &InspectAnswer) {
    for object in &answer.objects {
        if let Some(model) = &object.part_model {
            let size = harmony_scene::Size { width: 0.5, height: 0.9, depth: 0.5 };
            if let Ok(built) = model.build(size) {
                built.mesh.check().expect("a built mesh is sound");
            }
        }
    }
}

fuzz_target!(|data: &[u8]| {
    let Some((which, text)) = data.split_first() else { return };
    let text = String::from_utf8_lossy(text);
    let Ok(value) = parse_answer(&text) else { return };
    let which = usize::from(*which) % questions().len();
    let fits = schema_complaints(&questions()[which].schema, &value).is_empty();
    typed(which, &value, fits);
});

fn typed(which: usize, value: &Value, fits: bool) {
    let ids = ids();
    match which {
        0 => drop(parse::<LayoutAnswer>(value).map(|a| a.check())),
        1 | 2 => drop(parse::<ListAnswer>(value).map(|a| a.check())),
        3 => {
            if let Ok(answer) = parse::<InspectAnswer>(value) {
                if answer.check(&ids).is_ok() && fits {
                    models(&answer);
                }
            }
        }
        4 => drop(parse::<CompletedAnswer>(value).map(|a| a.check(&ids))),
        5 | 6 => drop(parse::<FrontsAnswer>(value).map(|a| a.check(&ids))),
        7 => drop(parse::<ReviewAnswer>(value).map(|a| a.check(&ids))),
        8 => {
            if let Ok(answer) = parse::<LightingSpec>(value) {
                let mut lighting = lighting();
                answer.apply(&mut lighting);
                finite(&lighting);
            }
        }
        _ => {
            if let Ok(answer) = parse::<LightingDelta>(value) {
                let mut lighting = lighting();
                answer.apply(&mut lighting, &Extents { width: 3.0, height: 2.5, depth: 4.0 });
                finite(&lighting);
            }
        }
    }
}
