//! Upholstery, cloth, hairy and woven things, plants.

use harmony_shape::tree::{Along, FringeKind, FuzzKind, HangTop, Kind, NodeId, PlantKind};

use crate::call::{ANGLE, COORDINATE, Call, FACES, Function, LENGTH, LENGTH0, Outcome, SHARE};
use crate::error::Complaint;
use crate::thing;

pub(crate) fn functions() -> Vec<Function> {
    vec![
        Function::new("pillow(w, h, t, wrinkle=0.5, piping=0, ears=0.3, dent=0, seed=None, ...)", |c| {
            c.make(Kind::Pillow {
                size: [c.need_number("w", LENGTH)?, c.need_number("h", LENGTH)?, c.need_number("t", LENGTH)?],
                wrinkle: c.number("wrinkle", 0.5, SHARE)?,
                piping: c.number("piping", 0.0, 0.0..=0.1)?,
                ears: c.number("ears", 0.3, SHARE)?,
                dent: c.number("dent", 0.0, SHARE)?,
                seed: c.seed()?,
            })
        }),
        Function::new("cushion(size, crown=0.02, sag=0, piping=0, bevel=0.03, ...)", |c| {
            let size = c.list("size", None, LENGTH)?;
            let most = size.into_iter().fold(f64::INFINITY, f64::min) / 2.0;
            c.make(Kind::Cushion {
                size,
                crown: c.number("crown", 0.02, LENGTH0)?.min(size[1] / 2.0),
                sag: c.number("sag", 0.0, LENGTH0)?.min(size[1] / 2.0),
                piping: c.number("piping", 0.0, 0.0..=0.1)?,
                bevel: c.number("bevel", 0.03, LENGTH0)?.min(most),
            })
        }),
        Function::new("tuft(part, face=\"front\", rows=3, cols=5, depth=0.03, diamond=True, button=0.012, ...)", |c| {
            let child = upholstered(c)?;
            c.make(Kind::Tuft {
                child,
                face: c.choice("face", &FACES, Some(harmony_shape::tree::Face::Front))?,
                rows: c.count("rows", 3, 1..=40)?,
                cols: c.count("cols", 5, 1..=40)?,
                depth: c.number("depth", 0.03, 0.0..=0.3)?,
                diamond: c.flag("diamond", true)?,
                button: c.number("button", 0.012, 0.0..=0.1)?,
            })
        }),
        Function::new("quilt(part, cell=0.12, depth=0.012, pattern=\"box\", face=\"top\", ...)", |c| {
            let child = upholstered(c)?;
            c.make(Kind::Quilt {
                child,
                face: c.choice("face", &FACES, Some(harmony_shape::tree::Face::Top))?,
                cell: c.number("cell", 0.12, 0.01..=5.0)?,
                depth: c.number("depth", 0.012, 0.0..=0.2)?,
                pattern: c.word("pattern", &["box", "diamond", "channel"], "box")?.to_owned(),
            })
        }),
        Function::new(
            "drape(w, l, over, at=(0, 0), turn=0, rumple=0.3, thick=0.01, fold=0, stiff=0.2, seed=None, ...)",
            |c| {
                let size = [c.need_number("w", 0.02..=20.0)?, c.need_number("l", 0.02..=20.0)?];
                c.make(Kind::Drape {
                    size,
                    over: c.parts("over")?,
                    at: flat(c, "at")?,
                    turn_deg: c.number("turn", 0.0, ANGLE)?,
                    rumple: c.number("rumple", 0.3, SHARE)?,
                    thick: c.number("thick", 0.01, 0.0005..=0.2)?,
                    fold: c.number("fold", 0.0, LENGTH0)?.min(size[1]),
                    stiff: c.number("stiff", 0.2, SHARE)?,
                    seed: c.seed()?,
                })
            },
        ),
        Function::new("hang(w, h, folds=8, gather=1.8, top=\"rings\", tie=0, seed=None, ...)", |c| {
            let tops = [("rings", HangTop::Rings), ("pleats", HangTop::Pleats), ("rod", HangTop::Rod)];
            c.make(Kind::Hang {
                size: [c.need_number("w", LENGTH)?, c.need_number("h", LENGTH)?],
                folds: c.count("folds", 8, 1..=100)?,
                gather: c.number("gather", 1.8, 1.0..=4.0)?,
                top: c.choice("top", &tops, Some(HangTop::Rings))?,
                tie: c.number("tie", 0.0, SHARE)?,
                seed: c.seed()?,
            })
        }),
        Function::new("slump(part, amount=0.3, onto=None, ...)", |c| {
            let child = c.part("part")?;
            let id = c.add(Kind::Slump { child, amount: c.number("amount", 0.3, SHARE)? }, None)?;
            if c.given("onto").is_none() {
                return c.make(Kind::Group { children: vec![id] });
            }
            c.make(Kind::On { child: id, other: c.part("onto")?, u: 0.5, v: 0.5 })
        }),
        Function::new("roll(w, r, turns=4, thick=0.006, ...)", |c| {
            c.make(Kind::Roll {
                width: c.need_number("w", LENGTH)?,
                radius: c.need_number("r", LENGTH)?,
                turns: c.number("turns", 4.0, 0.5..=40.0)?,
                thick: c.number("thick", 0.006, 1e-4..=0.2)?,
            })
        }),
        Function::new("folded(w, d, layers=4, thick=0.01, seed=None, ...)", |c| {
            c.make(Kind::Folded {
                size: [c.need_number("w", LENGTH)?, c.need_number("d", LENGTH)?],
                layers: c.count("layers", 4, 1..=60)?,
                thick: c.number("thick", 0.01, 1e-4..=0.2)?,
                seed: c.seed()?,
            })
        }),
        Function::new("fringe(curve, kind=\"thread\", length=0.06, spacing=0.01, jitter=0.3, seed=None, ...)", fringe),
        Function::new("fuzz(part, length=0.01, density=0.6, kind=\"pile\", seed=None, ...)", |c| {
            let kinds = [
                ("pile", FuzzKind::Pile),
                ("terry", FuzzKind::Terry),
                ("boucle", FuzzKind::Boucle),
                ("fur", FuzzKind::Fur),
            ];
            c.make(Kind::Fuzz {
                child: c.part("part")?,
                fuzz: c.choice("kind", &kinds, Some(FuzzKind::Pile))?,
                length: c.number("length", 0.01, 1e-4..=0.3)?,
                density: c.number("density", 0.6, SHARE)?,
                seed: c.seed()?,
            })
        }),
        Function::new("braid(curve, r, strands=3, pitch=0.06, ...)", |c| {
            c.make(Kind::Braid {
                curve: (*c.curve("curve")?).clone(),
                radius: c.need_number("r", LENGTH)?,
                strands: c.count("strands", 3, 2..=12)?,
                pitch: c.number("pitch", 0.06, 0.001..=10.0)?,
            })
        }),
        Function::new("wicker(part, cell=0.03, r=0.003, ...)", |c| {
            c.make(Kind::Wicker {
                child: c.part("part")?,
                cell: c.number("cell", 0.03, 0.004..=1.0)?,
                radius: c.number("r", 0.003, 2e-4..=0.1)?,
            })
        }),
        Function::new("mesh_wire(outline, pitch=0.03, r=0.0015, ...)", |c| {
            c.make(Kind::WireNet {
                outline: (*c.outline("outline")?).clone(),
                pitch: c.number("pitch", 0.03, 0.002..=5.0)?,
                radius: c.number("r", 0.0015, 1e-4..=0.1)?,
            })
        }),
        Function::new("leaf(l, w, kind=\"oval\", fold=20, curl=20, ...)", |c| {
            c.make(Kind::Leaf {
                size: [c.need_number("l", LENGTH)?, c.need_number("w", LENGTH)?],
                shape: c.word("kind", &["oval", "lance", "heart", "round", "lobed", "blade"], "oval")?.to_owned(),
                fold_deg: c.number("fold", 20.0, -90.0..=90.0)?,
                curl_deg: c.number("curl", 20.0, -360.0..=360.0)?,
            })
        }),
        Function::new("plant(kind, h, spread, n=40, leaf=None, flower=None, seed=None, ...)", |c| {
            let kinds = [
                ("bush", PlantKind::Bush),
                ("rosette", PlantKind::Rosette),
                ("fern", PlantKind::Fern),
                ("vine", PlantKind::Vine),
                ("succulent", PlantKind::Succulent),
                ("palm", PlantKind::Palm),
                ("grass", PlantKind::Grass),
                ("flowers", PlantKind::Flowers),
                ("tree", PlantKind::Tree),
            ];
            let leaf = if c.given("leaf").is_some() { Some(c.part("leaf")?) } else { None };
            c.make(Kind::Plant {
                plant: c.choice("kind", &kinds, None)?,
                height: c.need_number("h", LENGTH)?,
                spread: c.need_number("spread", LENGTH)?,
                count: c.count("n", 40, 1..=3000)?,
                leaf,
                flower: c.material("flower")?,
                seed: c.seed()?,
            })
        }),
    ]
}

/// Two numbers across the floor; of a point in space x and z.
pub(crate) fn flat(c: &Call<'_, '_>, name: &str) -> Result<[f64; 2], Complaint> {
    match c.given(name).and_then(crate::numbers::vector) {
        Some(p) if p.abs().max_element() <= *COORDINATE.end() => Ok([p.x, p.z]),
        _ => c.list(name, Some([0.0; 2]), COORDINATE),
    }
}

/// The argument `part`, which must be something that is upholstered.
fn upholstered(c: &Call<'_, '_>) -> Result<NodeId, Complaint> {
    let id = c.part("part")?;
    let mut at = id;
    loop {
        let next = c.session.with_node(at, |node| match &node.kind {
            Kind::Cushion { .. } | Kind::Box { .. } | Kind::Pillow { .. } => Ok(None),
            Kind::Tuft { child, .. } | Kind::Quilt { child, .. } | Kind::Paint { child, .. } => Ok(Some(*child)),
            _ => Err(()),
        });
        match next {
            Ok(None) => return Ok(id),
            Ok(Some(child)) => at = child,
            Err(()) => {
                let is = c.session.describe(id);
                let hint = "call it on the cushion(), then move the result: tuft(cushion(...)).at(...)";
                return Err(c.complain("part", &format!("a {is}"), "a cushion, box or pillow").with_hint(hint));
            }
        }
    }
}

fn fringe<'v>(c: &mut Call<'v, '_>) -> Outcome<'v> {
    let kinds = [
        ("thread", FringeKind::Thread),
        ("tassel", FringeKind::Tassel),
        ("pompom", FringeKind::Pompom),
        ("lace", FringeKind::Lace),
    ];
    let value = c.need("curve")?;
    let along = match thing::Thing::from_value(value).map(|t| &t.kind) {
        Some(thing::Kind::Hem(of, side)) => Along::Hem { of: *of, side: side.to_string() },
        _ => Along::Curve((*c.curve("curve")?).clone()),
    };
    let spacing = c.number("spacing", 0.01, 0.002..=5.0)?;
    let length = match &along {
        Along::Curve(curve) => crate::curves::length(curve),
        Along::Hem { .. } => 4.0,
    };
    c.session.charge_places((length / spacing) as u64)?;
    c.make(Kind::Fringe {
        along,
        fringe: c.choice("kind", &kinds, Some(FringeKind::Thread))?,
        length: c.number("length", 0.06, 0.002..=3.0)?,
        spacing,
        jitter: c.number("jitter", 0.3, SHARE)?,
        seed: c.seed()?,
    })
}
