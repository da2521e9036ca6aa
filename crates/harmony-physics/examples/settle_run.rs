//! Bodies, settling, repair and an earthquake of run folders, with times: for looking at many at once.
//!
//! `cargo run --release -p harmony-physics --example settle_run -- RUN ...`
#![expect(clippy::print_stdout, reason = "a program for people")]

use std::path::Path;
use std::time::Instant;

use harmony_physics::{BodySettings, Motion, Quake, RunScene, bodies, places, plausibility, repair, settle, shake};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    for run in std::env::args().skip(1) {
        let loaded = RunScene::read(Path::new(&run))?;
        let out = Path::new(&run).join("7_world");
        std::fs::create_dir_all(out.join("hulls"))?;
        let started = Instant::now();
        let made = bodies(&loaded.scene, &loaded.meshes, &BodySettings { cache: Some(out.join("hulls")) })?;
        harmony_io::write_json(&out.join("bodies.json"), &made)?;
        let bodies_s = started.elapsed().as_secs_f64();
        let started = Instant::now();
        let start = places(&loaded.scene);
        let settled = settle(&loaded.scene, &made, &start);
        let settle_s = started.elapsed().as_secs_f64();
        println!("== {run}: {} bodies {bodies_s:.1} s, settled {settle_s:.1} s", made.objects.len());
        for (o, b) in settled.objects.iter().zip(&made.objects) {
            let gap = o.gap_m.map_or(f64::NAN, |g| 100.0 * g);
            println!(
                "{:24} {:>7} {:7.2} kg {:3} hulls fit {:4.1} cm in {:5.2} gap {gap:5.2} drift {:6.2} cm tilt {:5.1} v {:4.2} {} {:?} {}",
                o.id,
                if o.motion == Motion::Static { "static" } else { "" },
                o.mass_kg,
                o.hulls,
                100.0 * o.fit_m,
                100.0 * o.penetration_m,
                100.0 * o.drift_m,
                o.tilt_deg,
                o.fastest_m_s,
                if o.stable { "" } else { "UNSTABLE" },
                o.touches,
                b.notes.join("; "),
            );
        }
        for p in settled.penetrations.iter().take(8) {
            println!("   {} in {}: {:.2} cm", p.object, p.other, 100.0 * p.depth_m);
        }
        for (name, value, good) in plausibility(&loaded.scene, &made, &start, &settled).rows() {
            println!("   {name}: {value} {}", if good { "" } else { "-" });
        }
        let started = Instant::now();
        let repaired = repair(&loaded.scene, &made, &start, &settled);
        println!("repaired to {:?} in {:.1} s", repaired.after.stable(), started.elapsed().as_secs_f64());
        for r in &repaired.repairs {
            println!("   {} moved {:.2} cm: {}", r.id, 100.0 * r.moved_m, r.reasons.join("; "));
        }
        for u in &repaired.unrepaired {
            println!("   {}: {}", u.id, u.reason);
        }
        harmony_io::write_json(
            &out.join("settle.json"),
            &serde_json::json!({ "settled": settled, "repaired": repaired }),
        )?;
        let started = Instant::now();
        let shaken = shake(&loaded.scene, &made, &Quake { intensity: 8.0, seconds: 10.0, seed: 0 })?;
        println!("earthquake in {:.1} s", started.elapsed().as_secs_f64());
        for o in shaken.objects.iter().filter(|o| o.motion == Motion::Dynamic) {
            println!("   {:24} farthest {:6.1} cm tilt {:5.1}", o.id, 100.0 * o.farthest_m, o.tilt_deg);
        }
    }
    Ok(())
}
