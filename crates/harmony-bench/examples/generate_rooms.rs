//! Writes rooms: `cargo run --release -p harmony-bench --example generate_rooms -- FOLDER FIRST_SEED COUNT`.

use std::error::Error;
use std::io::Write;
use std::path::Path;
use std::time::Instant;

use harmony_bench::generate::{GeneratorSettings, generate, write};

fn main() -> Result<(), Box<dyn Error>> {
    let mut args = std::env::args().skip(1);
    let (Some(folder), Some(first), Some(count)) = (args.next(), args.next(), args.next()) else {
        return Err("usage: generate_rooms FOLDER FIRST_SEED COUNT".into());
    };
    let (first, count): (u64, u64) = (first.parse()?, count.parse()?);
    let settings = GeneratorSettings::default();
    let mut log = std::io::stderr();
    for seed in first..first + count {
        let start = Instant::now();
        let room = generate(seed, &settings);
        let target = Path::new(&folder).join(&room.name);
        write(&room, &target)?;
        let seen = room.objects.iter().filter(|o| o.visible_pixels > 500).count();
        let walls = room.ids.iter().fold([0_usize; 256], |mut c, i| {
            c[usize::from(*i)] += 1;
            c
        });
        let walls = [3, 6, 4, 5].iter().filter(|i| walls[**i] > 500).count();
        writeln!(
            log,
            "{} {:?}: {} objects, {seen} in view, {walls} walls, {:.1} s",
            room.name,
            room.kind,
            room.objects.len(),
            start.elapsed().as_secs_f64()
        )?;
    }
    Ok(())
}
