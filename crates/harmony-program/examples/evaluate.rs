//! Evaluates a program and prints its tree as JSON: `evaluate FILE W H D [NAME=NUMBER ...]`. In this process, so only for
//! programs of your own.

use harmony_program::{Inputs, Limits, evaluate};
use harmony_scene::Size;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let args: Vec<String> = std::env::args().collect();
    let [_, file, w, h, d, params @ ..] = args.as_slice() else { return Err("FILE W H D [NAME=NUMBER ...]".into()) };
    let size = Size { width: w.parse()?, height: h.parse()?, depth: d.parse()? };
    let mut inputs = Inputs::object(size);
    for param in params {
        let (name, value) = param.split_once('=').ok_or("NAME=NUMBER")?;
        inputs = inputs.with(name, value.parse::<f64>()?);
    }
    let tree = evaluate(&std::fs::read_to_string(file)?, &inputs, &Limits::default())?;
    serde_json::to_writer(std::io::stdout().lock(), &tree)?;
    Ok(())
}
