//! Writes part models in metres; the model itself keeps fractions.

use glam::DVec3;
use harmony_scene::{MaterialCategory, Size};

use super::{LegStyle, TemplateParams};
use crate::{
    Axis, LeafHabit, Mirror, Part, PartModel, Repeat, Repeats, Shape, Slot, TextureMode, hex_color, parse_color,
};

/// A range along one axis, metres from left, bottom or back.
pub(super) type Span = [f64; 2];

/// A part under construction, in metres of the object.
#[derive(Debug, Clone)]
pub(super) struct Piece {
    part: Part,
    low: DVec3,
    high: DVec3,
}

impl Piece {
    pub fn new(shape: Shape, slot: &str, x: Span, y: Span, z: Span) -> Self {
        Self {
            part: Part { shape, slot: Some(slot.to_owned()), ..Part::default() },
            low: DVec3::new(x[0], y[0], z[0]),
            high: DVec3::new(x[1], y[1], z[1]),
        }
    }

    /// Edge radius in metres.
    pub fn round(mut self, radius: f64) -> Self {
        let smallest = (self.high - self.low).abs().min_element().max(1e-6);
        self.part.round = Some((radius / smallest).clamp(0.0, 0.5));
        self
    }

    pub fn corner(mut self, fraction: f64) -> Self {
        self.part.corner = Some(fraction);
        self
    }

    pub fn puff(mut self, puff: f64) -> Self {
        self.part.puff = Some(puff);
        self
    }

    pub fn turn(mut self, x: f64, y: f64, z: f64) -> Self {
        self.part.turn_deg = Some([x, y, z]);
        self
    }

    pub fn mirror(mut self, mirror: Mirror) -> Self {
        self.part.mirror = Some(mirror);
        self
    }

    pub fn axis(mut self, axis: Axis) -> Self {
        self.part.axis = Some(axis);
        self
    }

    pub fn square(mut self, axis: Axis) -> Self {
        self.part.square = Some(axis);
        self
    }

    pub fn top(mut self, ratio: f64) -> Self {
        self.part.top = Some(ratio);
        self
    }

    pub fn hollow(mut self, wall: f64) -> Self {
        self.part.hollow = Some(wall);
        self
    }

    pub fn oval(mut self) -> Self {
        self.part.oval = Some(true);
        self
    }

    pub fn sides(mut self, sides: u32) -> Self {
        self.part.sides = Some(sides);
        self
    }

    pub fn bend(mut self, degrees: f64) -> Self {
        self.part.bend_deg = Some(degrees);
        self
    }

    /// Thickness in metres, for an object whose smallest side is `smallest`.
    pub fn thick(mut self, metres: f64, smallest: f64) -> Self {
        self.part.thickness = Some(metres / smallest);
        self
    }

    pub fn points(mut self, points: &[[f64; 2]]) -> Self {
        self.part.points = Some(points.to_vec());
        self
    }

    pub fn path(mut self, path: &[[f64; 3]]) -> Self {
        self.part.path = Some(path.to_vec());
        self
    }

    pub fn smooth(mut self, smooth: bool) -> Self {
        self.part.smooth = Some(smooth);
        self
    }

    pub fn closed(mut self) -> Self {
        self.part.closed = Some(true);
        self
    }

    pub fn leaves(mut self, habit: LeafHabit, count: u32, leaf_size: f64) -> Self {
        self.part.habit = Some(habit);
        self.part.count = Some(count);
        self.part.leaf_size = Some(leaf_size);
        self
    }

    pub fn seed(mut self, seed: u32) -> Self {
        self.part.seed = Some(seed);
        self
    }

    pub fn folds(mut self, folds: u32) -> Self {
        self.part.folds = Some(folds);
        self
    }
}

/// Collects pieces and slots.
pub(super) struct Maker {
    pub w: f64,
    pub h: f64,
    pub d: f64,
    /// Smallest side.
    pub smallest: f64,
    slots: Vec<Slot>,
    parts: Vec<Part>,
}

impl Maker {
    pub fn new(size: Size) -> Self {
        let fix = |v: f64| if v.is_finite() { v.clamp(0.005, 40.0) } else { 0.5 };
        let (w, h, d) = (fix(size.width), fix(size.height), fix(size.depth));
        Self { w, h, d, smallest: w.min(h).min(d), slots: Vec::new(), parts: Vec::new() }
    }

    /// Declares a slot; the first declaration counts.
    pub fn slot(&mut self, name: &str, color: &str, material: MaterialCategory) {
        self.slot_with(name, color, material, TextureMode::Photo);
    }

    /// A slot that keeps its colour: glass, mirrors.
    pub fn plain_slot(&mut self, name: &str, color: &str, material: MaterialCategory) {
        self.slot_with(name, color, material, TextureMode::Plain);
    }

    fn slot_with(&mut self, name: &str, color: &str, material: MaterialCategory, texture: TextureMode) {
        if !self.slots.iter().any(|s| s.name == name) {
            let material = Some(material);
            self.slots.push(Slot { name: name.to_owned(), color: color.to_owned(), material, texture });
        }
    }

    pub fn add(&mut self, piece: Piece) {
        let size = DVec3::new(self.w, self.h, self.d);
        let (a, b) = (piece.low.min(piece.high), piece.low.max(piece.high));
        let b = b.max(a + DVec3::splat(4e-4));
        let limit = DVec3::splat(5.0);
        let part = Part {
            from: (a / size).clamp(-limit, limit).to_array(),
            to: (b / size).clamp(-limit, limit).to_array(),
            ..piece.part
        };
        if part.from.iter().zip(&part.to).all(|(f, t)| t - f > 1e-8) {
            self.parts.push(part);
        }
    }

    /// Adds copies in a row; `step` in metres.
    pub fn row(&mut self, piece: Piece, axis: Axis, count: u32, step: f64) {
        let extent = [self.w, self.h, self.d][axis as usize];
        self.add(piece);
        if let Some(part) = self.parts.last_mut() {
            part.repeat = Some(Repeats::Row(Repeat { axis, count: count.clamp(1, 60), step: Some(step / extent) }));
        }
    }

    pub fn cube(&mut self, slot: &str, x: Span, y: Span, z: Span) {
        let least = (x[1] - x[0]).abs().min((y[1] - y[0]).abs()).min((z[1] - z[0]).abs());
        self.add(Piece::new(Shape::Box, slot, x, y, z).round((least * 0.2).min(0.004)));
    }

    /// Legs of a style under `top`, on the floor, within a footprint inset from the sides.
    pub fn legs(&mut self, style: LegStyle, slot: &str, top: f64, inset: f64, thickness: f64) {
        let (w, d, s) = (self.w, self.d, self.smallest);
        let top = top.max(0.01);
        let t = thickness.min(w * 0.3).min(d * 0.3);
        let (x0, z0) = (inset.min(w * 0.3), inset.min(d * 0.3));
        match style {
            LegStyle::Four => {
                let leg = Piece::new(Shape::Box, slot, [x0, x0 + t], [0.0, top], [z0, z0 + t]);
                self.add(leg.round(t * 0.12).square(Axis::Y).mirror(Mirror::Xz));
            }
            LegStyle::Tapered => {
                let lean = 9.0_f64.min((0.3 * w.min(d) / top).atan().to_degrees());
                let slack = top * lean.to_radians().tan() * 0.5;
                let (x, z) = (x0 + slack, z0 + slack);
                let leg = Piece::new(Shape::Cylinder, slot, [x, x + t], [0.0, top], [z, z + t]);
                self.add(leg.top(1.7).turn(lean, 0.0, -lean).mirror(Mirror::Xz));
            }
            LegStyle::Pedestal => {
                let (cx, cz) = (w / 2.0, d / 2.0);
                let foot = 0.3 * w.min(d);
                let base = Piece::new(Shape::Lathe, slot, [cx - foot, cx + foot], [0.0, top], [cz - foot, cz + foot]);
                let neck = (t * 0.6 / foot).clamp(0.08, 0.5);
                let plate = (0.02 / top).clamp(0.01, 0.2);
                self.add(base.smooth(true).points(&[
                    [1.0, 0.0],
                    [0.97, plate],
                    [0.5, plate * 2.5],
                    [neck * 1.2, 0.25],
                    [neck, 0.5],
                    [neck * 1.1, 0.85],
                    [neck * 2.2, 1.0],
                ]));
            }
            LegStyle::Sled => {
                let r = t * 0.5;
                let bar = Piece::new(Shape::Tube, slot, [x0, x0 + r], [0.0, top], [z0, d - z0]);
                self.add(
                    bar.thick(r, s)
                        .path(&[[0.5, 1.0, 0.0], [0.5, 0.0, 0.0], [0.5, 0.0, 1.0], [0.5, 1.0, 1.0]])
                        .closed()
                        .mirror(Mirror::X),
                );
            }
            LegStyle::Hairpin => {
                let r = (t * 0.3).clamp(0.006, 0.014);
                let spread = (top * 0.22).min(0.1).min(w * 0.3).min(d * 0.3);
                let leg = Piece::new(Shape::Tube, slot, [x0, x0 + spread], [0.0, top], [z0, z0 + spread]);
                self.add(
                    leg.thick(r, s).path(&[[0.9, 1.0, 0.0], [0.05, 0.0, 0.05], [0.0, 1.0, 0.9]]).mirror(Mirror::Xz),
                );
            }
            LegStyle::StarWheels => self.star_base(slot, top),
            LegStyle::Block => {
                let (x, z) = (x0.max(0.01), z0.max(0.01));
                self.cube(slot, [x, w - x], [0.0, top], [z, d - z]);
            }
            LegStyle::Trestle => {
                let reach = d - 2.0 * z0;
                let length = (reach.powi(2) + top.powi(2)).sqrt();
                let tilt = (reach / top).atan().to_degrees();
                let (cy, cz) = (top / 2.0, d / 2.0);
                let board = Piece::new(
                    Shape::Box,
                    slot,
                    [x0, x0 + t],
                    [cy - length / 2.0 + t * 0.6, cy + length / 2.0 - t * 0.6],
                    [cz - t / 2.0, cz + t / 2.0],
                );
                let board = board.round(t * 0.12).mirror(Mirror::X);
                self.add(board.clone().turn(tilt, 0.0, 0.0));
                self.add(board.turn(-tilt, 0.0, 0.0));
            }
            LegStyle::None => {}
        }
    }

    /// Five spokes on castors and a gas lift.
    fn star_base(&mut self, slot: &str, top: f64) {
        let (cx, cz) = (self.w / 2.0, self.d / 2.0);
        let reach = 0.46 * self.w.min(self.d);
        let wheel = (top * 0.16).min(0.06).min(reach * 0.25);
        let column = reach * 0.09;
        let y = wheel + wheel * 0.25;
        let rise = (top * 0.12).min(0.05);
        for k in 0..5 {
            let azimuth = f64::from(k) * 72.0;
            let (sin, cos) = azimuth.to_radians().sin_cos();
            let (mx, mz) = (cx + sin * reach * 0.5, cz + cos * reach * 0.5);
            let spoke = Piece::new(
                Shape::Box,
                slot,
                [mx - column * 0.7, mx + column * 0.7],
                [y, y + rise],
                [mz - reach * 0.5, mz + reach * 0.5],
            );
            self.add(spoke.round(rise * 0.3).turn(4.0, azimuth, 0.0));
            let (ex, ez) = (cx + sin * reach * 0.95, cz + cos * reach * 0.95);
            let r = wheel / 2.0;
            let castor =
                Piece::new(Shape::Cylinder, "wheels", [ex - r * 0.8, ex + r * 0.8], [0.0, wheel], [ez - r, ez + r]);
            self.add(castor.axis(Axis::X).turn(0.0, azimuth + 20.0, 0.0).round(r * 0.4));
        }
        self.slot("wheels", "#222224", MaterialCategory::Plastic);
        let tube =
            Piece::new(Shape::Cylinder, slot, [cx - column, cx + column], [y, top * 0.62], [cz - column, cz + column]);
        self.add(tube);
        let lift = column * 0.6;
        self.add(Piece::new(Shape::Cylinder, slot, [cx - lift, cx + lift], [y, top], [cz - lift, cz + lift]));
    }

    /// The finished model, with the colours that were asked for.
    pub fn finish(mut self, params: &TemplateParams) -> PartModel {
        for wanted in &params.colors {
            let Some(rgb) = parse_color(&wanted.hex) else { continue };
            let name = wanted.slot.trim().to_lowercase();
            let all = matches!(name.as_str(), "all" | "main" | "body" | "primary");
            let exact = self.slots.iter().position(|s| s.name == name);
            let index = exact.or(if all && !self.slots.is_empty() { Some(0) } else { None });
            if let Some(slot) = index.and_then(|i| self.slots.get_mut(i)) {
                slot.color = hex_color(rgb);
            }
        }
        let used = |name: &str| self.parts.iter().any(|p| p.slot.as_deref() == Some(name));
        self.slots.retain(|s| used(&s.name));
        PartModel { slots: self.slots, parts: self.parts }
    }
}
