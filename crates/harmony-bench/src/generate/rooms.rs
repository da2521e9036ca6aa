//! The kinds of room and what belongs into them.

use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::sync::Arc;

use glam::{DVec2, DVec3};
use harmony_scene::Wall;

use super::dice::Dice;
use super::layout::{Facing, Plan, turn};
use super::paint::Palette;
use super::pieces::{self, Piece, TableStyle};

/// What a room is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[expect(missing_docs, reason = "the names say it")]
pub enum RoomKind {
    Bedroom,
    LivingRoom,
    DiningRoom,
    HomeOffice,
    Kitchen,
    Study,
    Bathroom,
    KidsRoom,
}

impl RoomKind {
    /// All kinds.
    pub const ALL: [Self; 8] = [
        Self::Bedroom,
        Self::LivingRoom,
        Self::DiningRoom,
        Self::HomeOffice,
        Self::Kitchen,
        Self::Study,
        Self::Bathroom,
        Self::KidsRoom,
    ];

    /// Range of width and depth, metres.
    pub(super) fn sizes(self) -> [f64; 2] {
        match self {
            Self::Bathroom => [2.6, 3.6],
            Self::Kitchen | Self::KidsRoom | Self::HomeOffice | Self::Study => [2.9, 4.8],
            Self::Bedroom => [3.2, 5.2],
            Self::DiningRoom => [3.4, 5.6],
            Self::LivingRoom => [3.8, 7.0],
        }
    }
}

const SIDES: [Wall; 4] = [Wall::Back, Wall::Back, Wall::Left, Wall::Right];

/// What every step of furnishing needs.
pub(super) struct Decorator<'a> {
    pub(super) dice: &'a mut Dice,
    pub(super) palette: &'a Palette,
    pub(super) plan: Plan,
    /// What the home around it asks of the room.
    pub(super) fixed: Option<&'a super::FixedRoom>,
}

impl Decorator<'_> {
    pub(super) fn make(&mut self, f: impl FnOnce(&mut Dice, &Palette) -> Piece) -> Arc<Piece> {
        Arc::new(f(self.dice, self.palette))
    }

    /// Furnishes the room.
    pub(super) fn furnish(&mut self, kind: RoomKind) {
        self.openings(kind);
        match kind {
            RoomKind::Bedroom => self.bedroom(),
            RoomKind::LivingRoom => self.living_room(),
            RoomKind::DiningRoom => self.dining_room(),
            RoomKind::HomeOffice => self.home_office(),
            RoomKind::Kitchen => self.kitchen(),
            RoomKind::Study => self.study(),
            RoomKind::Bathroom => self.bathroom(),
            RoomKind::KidsRoom => self.kids_room(),
        }
        self.finish(kind);
    }

    fn bedroom(&mut self) {
        let w = self.dice.f(1.4, 1.85);
        let long = self.dice.f(2.0, 2.2);
        let bed = self.make(|d, p| pieces::bed(d, p, w, long));
        let wall = self.dice.pick(&[Wall::Back, Wall::Back, Wall::Left, Wall::Right]);
        let Some(bed) = self.centred(&bed, wall) else { return };
        self.plan.items[bed].group = Some("sleeping");
        let stand = self.make(pieces::nightstand);
        let lamp = self.make(pieces::table_lamp);
        let stands = self.beside(bed, &stand);
        self.plan.group(&stands, "nightstands");
        let lamps: Vec<Option<usize>> = stands
            .iter()
            .map(|s| {
                s.and_then(|s| {
                    self.dice.chance(0.8).then(|| self.plan.on(self.dice, s, &lamp, Some([0.0, -0.6]), 0.0)).flatten()
                })
            })
            .collect();
        self.plan.group(&lamps, "bedside_lamps");
        for stand in stands.into_iter().flatten() {
            self.clutter(stand, 1);
        }
        self.rug_under(bed, [1.5, 1.2], 0.35);
        let height = self.dice.f(1.9, 2.2).min(self.plan.extents.height as f32 - 0.12);
        if self.dice.chance(0.75) {
            let wardrobe = self.make(|d, p| pieces::wardrobe(d, p, height));
            self.plan.against_any(self.dice, &wardrobe, &[Wall::Left, Wall::Right, Wall::Back]);
        }
        self.storage("dresser", [0.8, 1.3], [0.7, 0.95], 0.8);
        self.easy_chair(0.5);
        if self.dice.chance(0.45) {
            let bw = w * 0.75;
            let bench = self.make(|d, p| pieces::bench(d, p, bw));
            let item = &self.plan.items[bed];
            let p = item.to_room(DVec3::new(0.0, 0.0, item.piece.size.z / 2.0 + 0.1 + bench.size.z / 2.0));
            let yaw = item.yaw;
            self.plan.stand(&bench, DVec2::new(p.x, p.z), yaw, &[]);
        }
        if self.dice.chance(0.5) {
            let toy = if self.dice.chance(0.4) { self.make(pieces::teddy) } else { self.make(pieces::cushion) };
            self.plan.on(self.dice, bed, &toy, None, 0.0);
        }
    }

    fn living_room(&mut self) {
        let e = self.plan.extents;
        let width = self.dice.f(1.6, 2.5);
        let corner = (e.width > 4.4 && self.dice.chance(0.35)).then(|| self.dice.sign() as f32);
        let sofa = self.make(|d, p| pieces::sofa(d, p, width, corner));
        let wall = self.dice.pick(&[Wall::Back, Wall::Back, Wall::Left, Wall::Right]);
        let Some(sofa) = self.centred(&sofa, wall) else { return };
        let table = self.make(pieces::coffee_table);
        let (item, gap) = (self.plan.items[sofa].clone(), self.dice.range(0.32, 0.5));
        let shift = corner.map_or(0.0, |c| -f64::from(c) * 0.35);
        let p = item.to_room(DVec3::new(
            shift,
            0.0,
            item.piece.size.z / 2.0 + gap + table.size.z / 2.0 - if corner.is_some() { 0.6 } else { 0.0 },
        ));
        let table = self.plan.stand(&table, DVec2::new(p.x, p.z), item.yaw, &[]).or_else(|| {
            let p = item.to_room(DVec3::new(0.0, 0.0, item.piece.size.z / 2.0 + 0.25 + table.size.z / 2.0));
            self.plan.stand(&table, DVec2::new(p.x, p.z), item.yaw, &[])
        });
        if let Some(t) = table {
            self.plan.items[t].facing = Facing::Object(sofa);
            self.clutter(t, 2);
            self.rug_under(t, [2.0, 2.4], 0.0);
            let chair = self.make(pieces::armchair);
            for side in [-1.0, 1.0] {
                if self.dice.chance(0.7) {
                    let out = self.plan.items[t].piece.size.x / 2.0 + self.dice.range(0.3, 0.6) + chair.size.z / 2.0;
                    let p = self.plan.items[t].to_room(DVec3::new(side * out, 0.0, self.dice.range(0.0, 0.7)));
                    let yaw = item.yaw - side * FRAC_PI_2 + self.dice.range(-0.43, 0.43);
                    let other = if self.dice.chance(0.3) { self.make(pieces::armchair) } else { Arc::clone(&chair) };
                    if let Some(a) = self.plan.stand(&other, DVec2::new(p.x, p.z), yaw, &[]) {
                        self.plan.items[a].facing = Facing::Object(t);
                        self.plan.items[a].group = Some("seating");
                    }
                }
            }
        }
        self.plan.group(&[Some(sofa), table], "seating");
        let side = self.make(pieces::side_table);
        let lamp = self.make(pieces::table_lamp);
        let sides = self.beside(sofa, &side);
        self.plan.group(&sides, "seating");
        for s in sides.into_iter().flatten() {
            if self.dice.chance(0.7) {
                self.plan.on(self.dice, s, &lamp, Some([0.0, 0.0]), 0.0);
            } else {
                self.clutter(s, 1);
            }
        }
        let others: Vec<Wall> = [Wall::Back, Wall::Left, Wall::Right].into_iter().filter(|w| *w != wall).collect();
        let (w, h) = (self.dice.f(1.1, 1.7), self.dice.f(0.42, 0.55));
        let stand = self.make(|d, p| pieces::cabinet(d, p, "tv stand", [w, h, 0.42]));
        if let Some(stand) = self.plan.against_any(self.dice, &stand, &others) {
            let tv = self.make(|d, _| {
                let tw = d.f(0.8, w.min(1.25));
                pieces::monitor(d, "tv", tw)
            });
            let tv = self.plan.on(self.dice, stand, &tv, Some([0.0, -0.3]), 0.0);
            for i in [Some(stand), tv].into_iter().flatten() {
                self.plan.items[i].facing = Facing::Object(sofa);
            }
            self.plan.group(&[Some(stand), tv], "media");
        }
        self.shelves(1);
        self.storage("sideboard", [1.1, 1.7], [0.7, 0.9], 0.5);
        self.standing_lamp(0.7);
    }

    fn dining_room(&mut self) {
        self.dining([1.2, 2.0], 3);
        self.storage("sideboard", [1.1, 1.8], [0.7, 0.9], 0.9);
        self.storage("cabinet", [0.7, 1.0], [0.8, 1.3], 0.6);
        self.shelves(1);
        self.standing_lamp(0.5);
        self.easy_chair(0.3);
    }

    fn home_office(&mut self) {
        self.work_place(&SIDES);
        if self.plan.extents.width > 4.0 && self.dice.chance(0.3) {
            self.work_place(&[Wall::Left, Wall::Right]);
        }
        self.shelves(2);
        self.storage("cabinet", [0.6, 1.1], [0.6, 0.9], 0.8);
        self.bin();
        self.easy_chair(0.4);
        self.standing_lamp(0.5);
    }

    fn study(&mut self) {
        self.shelves(3);
        self.work_place(&SIDES);
        self.easy_chair(0.9);
        self.standing_lamp(0.8);
        self.storage("cabinet", [0.7, 1.2], [0.6, 1.0], 0.7);
        self.bin();
        if self.dice.chance(0.5) {
            let rug = self.make(|d, p| {
                let (w, h) = (d.f(1.4, 2.2), d.f(1.0, 1.6));
                pieces::rug(d, p, w, h)
            });
            self.plan.anywhere(self.dice, &rug, 0.0, 0.0);
        }
    }

    fn kitchen(&mut self) {
        let e = self.plan.extents;
        let wall = Wall::Back;
        let fridge = self.make(pieces::fridge);
        let (bw, bh) = (self.dice.f(0.45, 0.62), self.dice.f(0.86, 0.92));
        let first = self.make(|d, p| pieces::cabinet(d, p, "base cabinet", [bw, bh, 0.6]));
        let second = self.make(|d, p| pieces::cabinet(d, p, "base cabinet", [bw, bh, 0.6]));
        let upper_h = self.dice.f(0.55, 0.75);
        let upper = self.make(|d, p| pieces::wall_cabinet(d, p, bw, upper_h));
        let left = self.dice.chance(0.5);
        let mut u = 0.08;
        let place = |u: f64| if left { u } else { e.width - u };
        let mut row = Vec::new();
        if let Some(i) = self.plan.against(&fridge, wall, place(u + fridge.size.x / 2.0), 0.0) {
            self.plan.items[i].group = Some("kitchen_row");
            u += fridge.size.x + 0.03;
        }
        let n = (((e.width - u - 0.1) / (f64::from(bw) + 0.026)) as usize).min(self.dice.int(3, 5));
        for _ in 0..n {
            let piece = if self.dice.chance(0.6) { &first } else { &second };
            let at = place(u + piece.size.x / 2.0);
            if let Some(i) = self.plan.against(piece, wall, at, 0.0) {
                self.plan.items[i].group = Some("kitchen_row");
                row.push(i);
                let y = 1.42 + f64::from(upper_h) / 2.0;
                if self.dice.chance(0.7) {
                    let up = self.plan.on_wall(&upper, wall, [at, y], 0.003);
                    self.plan.group(&[up], "wall_cabinets");
                }
            }
            u += piece.size.x + 0.028;
        }
        for i in row {
            if self.dice.chance(0.6) {
                let thing = match self.dice.int(0, 4) {
                    0 => self.make(pieces::kettle),
                    1 => self.make(pieces::bowl),
                    2 => self.make(pieces::vase),
                    3 => self.make(pieces::small_plant),
                    _ => self.make(pieces::mug),
                };
                self.plan.on(self.dice, i, &thing, None, 0.0);
            }
        }
        self.dining([0.9, 1.4], 2);
        self.bin();
        self.shelves(1);
    }

    fn bathroom(&mut self) {
        let w = self.dice.f(1.4, 1.75).min(self.plan.extents.width as f32 - 0.2);
        let tub = self.make(|d, p| pieces::bathtub(d, p, w));
        self.plan.against_any(self.dice, &tub, &SIDES);
        let basin = self.make(pieces::washbasin);
        if let Some(i) = self.plan.against_any(self.dice, &basin, &SIDES)
            && let Some(wall) = self.plan.items[i].wall
        {
            let u = wall.coordinates(self.plan.items[i].position).x;
            let mirror = self.make(pieces::mirror);
            self.plan.on_wall(&mirror, wall, [u, 1.15 + mirror.size.y / 2.0], 0.002);
        }
        let toilet = self.make(pieces::toilet);
        self.plan.against_any(self.dice, &toilet, &SIDES);
        self.storage("cabinet", [0.4, 0.7], [0.7, 1.2], 0.8);
        for _ in 0..self.dice.int(1, 2) {
            let basket = self.make(pieces::basket);
            self.plan.edge(self.dice, &basket);
        }
        let stool = self.make(pieces::stool);
        self.plan.anywhere(self.dice, &stool, 0.0, 3.0);
        self.bin();
    }

    fn kids_room(&mut self) {
        let w = self.dice.f(0.9, 1.1);
        let long = self.dice.f(1.7, 2.05);
        let bed = self.make(|d, p| pieces::bed(d, p, w, long));
        let bed = self.plan.against_any(self.dice, &bed, &SIDES);
        if let Some(bed) = bed {
            let bear = self.make(pieces::teddy);
            self.plan.on(self.dice, bed, &bear, None, 0.0);
            let stand = self.make(pieces::nightstand);
            for s in self.beside(bed, &stand).into_iter().flatten() {
                self.clutter(s, 1);
            }
        }
        self.work_place(&SIDES);
        self.shelves(1);
        self.storage("dresser", [0.7, 1.1], [0.6, 0.9], 0.8);
        for _ in 0..self.dice.int(1, 4) {
            let toy = match self.dice.int(0, 3) {
                0 => self.make(pieces::ball),
                1 => self.make(pieces::basket),
                2 => self.make(pieces::pouf),
                _ => self.make(pieces::teddy),
            };
            self.plan.anywhere(self.dice, &toy, 0.0, 3.1);
        }
        let rug = self.make(|d, p| {
            let (w, h) = (d.f(1.2, 1.9), d.f(1.0, 1.5));
            pieces::rug(d, p, w, h)
        });
        self.plan.anywhere(self.dice, &rug, 0.0, 0.0);
    }

    /// A table with chairs around it.
    fn dining(&mut self, length: [f32; 2], most: usize) {
        let e = self.plan.extents;
        let round = self.dice.chance(0.35);
        let w = self.dice.f(length[0], length[1]).min(e.width as f32 - 1.6);
        let r = self.dice.f(0.95, 1.3);
        let (size, style) =
            if round { ([r, r], TableStyle::Pedestal) } else { ([w, self.dice.f(0.78, 0.95)], TableStyle::Legs) };
        let table = self.make(|d, p| pieces::dining_table(d, p, size, style));
        let turned = !round && e.depth > e.width && self.dice.chance(0.3);
        let yaw = if turned { FRAC_PI_2 } else { 0.0 };
        let Some(t) = (0..12).find_map(|_| {
            let at = DVec2::new(e.width * self.dice.range(0.38, 0.62), e.depth * self.dice.range(0.36, 0.56));
            self.plan.stand(&table, at, yaw, &[])
        }) else {
            return;
        };
        self.plan.items[t].group = Some("dining");
        let chair = self.make(pieces::chair);
        let mut spots: Vec<(DVec2, f64)> = Vec::new();
        let back = chair.size.z / 2.0;
        if round {
            let (n, first) = (self.dice.int(2, 5), self.dice.range(0.0, TAU));
            for i in 0..n {
                let a = first + i as f64 / n as f64 * TAU;
                let out = f64::from(r) / 2.0 + back - self.dice.range(-0.05, 0.16);
                spots.push((DVec2::new(a.sin(), a.cos()) * out, a + PI));
            }
        } else {
            let (w, b) = (f64::from(size[0]), f64::from(size[1]));
            let n = (((w - 0.25) / (chair.size.x + 0.1)) as usize).clamp(1, most);
            for side in [-1.0, 1.0] {
                let tuck = self.dice.range(0.0, 0.26);
                for i in 0..n {
                    let x = (w - 0.3) * ((i as f64 + 0.5) / n as f64 - 0.5);
                    let pull = if self.dice.chance(0.2) { -0.15 } else { self.dice.range(-0.03, 0.03) };
                    let z = side * (b / 2.0 + back - tuck - pull.min(tuck));
                    spots.push((DVec2::new(x, z), if side > 0.0 { PI } else { 0.0 }));
                }
                if self.dice.chance(0.4) {
                    spots.push((
                        DVec2::new(side * (w / 2.0 + back - self.dice.range(-0.05, 0.18)), 0.0),
                        -side * FRAC_PI_2,
                    ));
                }
            }
        }
        let origin = self.plan.items[t].position;
        let mut chairs = Vec::new();
        for (at, facing) in spots {
            let p = origin + turn(yaw, DVec3::new(at.x, 0.0, at.y));
            let off = if self.dice.chance(0.25) { self.dice.range(-0.4, 0.4) } else { self.dice.range(-0.1, 0.1) };
            if let Some(c) = self.plan.stand(&chair, DVec2::new(p.x, p.z), yaw + facing + off, &[t]) {
                self.plan.items[c].facing = Facing::Object(t);
                self.plan.items[c].tucked = Some(t);
                chairs.push(Some(c));
            }
        }
        self.plan.group(&chairs, "dining_chairs");
        if self.dice.chance(0.6) {
            self.rug_under(t, [1.9, 2.2], 0.0);
        }
        let centre = if self.dice.chance(0.5) { self.make(pieces::vase) } else { self.make(pieces::bowl) };
        self.plan.on(self.dice, t, &centre, Some([0.0, 0.0]), 0.0);
        if self.dice.chance(0.55) {
            let plate = self.make(pieces::plate);
            let mut plates = Vec::new();
            for c in chairs.iter().flatten() {
                let d = self.plan.items[*c].position - origin;
                let local = turn(-yaw, d);
                let table = &self.plan.items[t].piece;
                let k = if round { 0.95 / local.length().max(0.1) } else { 1.0 };
                let sx = if round { local.x * k } else { (local.x / (table.size.x * 0.45)).clamp(-0.8, 0.8) };
                let sz = if round { local.z * k } else { (local.z / (table.size.z * 0.45)).clamp(-0.8, 0.8) };
                plates.push(self.plan.on(self.dice, t, &plate, Some([sx, sz]), 0.0));
            }
            self.plan.group(&plates, "plates");
        } else {
            self.clutter(t, 2);
        }
        let n = if round { 1 } else { self.dice.int(1, 3) };
        let drop = (self.plan.extents.height - 1.5).clamp(0.55, 1.1) as f32;
        let lamp = if n == 1 && self.dice.chance(0.4) {
            self.make(|d, p| pieces::chandelier(d, p, drop.min(0.8)))
        } else {
            self.make(|d, p| pieces::pendant(d, p, drop))
        };
        let mut lamps = Vec::new();
        for i in 0..n {
            let x = (f64::from(size[0]) - 0.2) * ((i as f64 + 0.5) / n as f64 - 0.5);
            let p = origin + turn(yaw, DVec3::new(x, 0.0, 0.0));
            lamps.push(self.plan.hang(&lamp, DVec2::new(p.x, p.z), 0.0));
        }
        if n > 1 {
            self.plan.group(&lamps, "pendants");
        }
    }
}
