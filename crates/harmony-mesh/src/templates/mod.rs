//! Part models by category, for when nobody describes the object.

mod appliances;
mod decor;
mod lights;
mod maker;
mod names;
mod params;
mod seating;
mod storage;
mod tables;
mod wall;

use harmony_scene::{MaterialCategory, Size};

use maker::{Maker, Piece};
pub use names::template_name;
pub use params::{ArmStyle, BackStyle, LegStyle, PlantHabit, ShadeShape, SlotColor, TemplateParams};

use crate::{PartModel, Shape};

/// The part model of a category (a template's name or a free label) at a size; unknown things become a rounded body
/// with plausible proportions.
pub fn template(category: &str, params: &TemplateParams, size: Size) -> PartModel {
    let mut maker = Maker::new(size);
    let m = &mut maker;
    let hinted = names::with_hints(category, params);
    let p = &hinted;
    let name = template_name(category).unwrap_or("");
    match name {
        "sofa" => seating::sofa(m, p),
        "armchair" => seating::armchair(m, p),
        "chair" => seating::chair(m, p),
        "office_chair" => seating::office_chair(m, p),
        "stool" => seating::stool(m, p),
        "bench" => seating::bench(m, p),
        "ottoman" => seating::ottoman(m, p),
        "bean_bag" => seating::bean_bag(m, p),
        "coat_rack" => seating::coat_rack(m, p),
        "bed" => storage::bed(m, p),
        "crib" => storage::crib(m, p),
        "nightstand" => storage::nightstand(m, p),
        "dresser" => storage::dresser(m, p),
        "cabinet" => storage::cabinet(m, p),
        "tv_stand" => storage::tv_stand(m, p),
        "wardrobe" => storage::wardrobe(m, p),
        "bookshelf" => storage::bookshelf(m, p),
        "wall_shelf" => storage::wall_shelf(m, p),
        "kitchen_base" => storage::kitchen_base(m, p),
        "kitchen_wall" => storage::kitchen_wall(m, p),
        "fridge" => appliances::fridge(m, p),
        "oven" => appliances::oven(m, p),
        "microwave" => appliances::microwave(m, p),
        "washing_machine" => appliances::washing_machine(m, p),
        "dishwasher" => appliances::dishwasher(m, p),
        "range_hood" => appliances::range_hood(m, p),
        "toilet" => appliances::toilet(m, p),
        "bathtub" => appliances::bathtub(m, p),
        "sink" => appliances::sink(m, p),
        "tv" => appliances::tv(m, p),
        "monitor" => appliances::monitor(m, p),
        "laptop" => appliances::laptop(m, p),
        "keyboard" => appliances::keyboard(m, p),
        "speaker" => appliances::speaker(m, p),
        "kettle" => appliances::kettle(m, p),
        "dining_table" => tables::dining(m, p),
        "coffee_table" => tables::coffee(m, p),
        "round_table" => tables::round(m, p),
        "desk" => tables::desk(m, p),
        "side_table" => tables::side(m, p),
        "console_table" => tables::console(m, p),
        "piano" => tables::piano(m, p),
        "floor_lamp" => lights::floor_lamp(m, p),
        "tripod_lamp" => lights::tripod_lamp(m, p),
        "arc_lamp" => lights::arc_lamp(m, p),
        "table_lamp" => lights::table_lamp(m, p),
        "desk_lamp" => lights::desk_lamp(m, p),
        "pendant" => lights::pendant(m, p),
        "chandelier" => lights::chandelier(m, p),
        "ceiling_light" => lights::ceiling_light(m, p),
        "ceiling_fan" => lights::ceiling_fan(m, p),
        "wall_sconce" => lights::wall_sconce(m, p),
        "fan" => lights::fan(m, p),
        "candle" => lights::candle(m, p),
        "radiator" => lights::radiator(m, p),
        "rug" => wall::rug(m, p),
        "curtain" => wall::curtain(m, p),
        "blind" => wall::blind(m, p),
        "window" => wall::window(m, p),
        "door" => wall::door(m, p),
        "painting" => wall::painting(m, p),
        "mirror" => wall::mirror(m, p),
        "clock" => wall::clock(m, p),
        "towel" => wall::towel(m, p),
        "fireplace" => wall::fireplace(m, p),
        "wall_plate" => wall::wall_plate(m, p),
        "air_conditioner" => wall::air_conditioner(m, p),
        "cushion" => decor::pillow(m, p),
        "blanket" => decor::blanket(m, p),
        "book" => decor::book(m, p),
        "book_stack" => decor::book_stack(m, p),
        "vase" => decor::vase(m, p),
        "flowers" => decor::vase(m, &TemplateParams { filled: p.filled.or(Some(true)), ..p.clone() }),
        "bottle" => decor::bottle(m, p),
        "bowl" => decor::bowl(m, p),
        "plate" => decor::plate(m, p),
        "cup" => decor::cup(m, p),
        "box" => decor::carton(m, p),
        "basket" => decor::basket(m, p),
        "trash_bin" => decor::trash_bin(m, p),
        "plant" => decor::plant(m, p),
        "teddy_bear" => decor::teddy_bear(m, p),
        "figurine" => decor::figurine(m, p),
        "suitcase" => decor::suitcase(m, p),
        "guitar" => decor::guitar(m, p),
        _ => unknown(m, p),
    }
    maker.finish(p)
}

/// Something unknown, by its proportions: a flat board, a slender turned body, or a rounded box.
fn unknown(m: &mut Maker, p: &TemplateParams) {
    m.slot("body", "#a39a8d", MaterialCategory::Other);
    let (w, h, d) = (m.w, m.h, m.d);
    let whole = |shape| Piece::new(shape, "body", [0.0, w], [0.0, h], [0.0, d]);
    let footprint = w.min(d) / w.max(d);
    if m.smallest < 0.06 * w.max(h).max(d) {
        m.add(whole(Shape::Slab).corner(0.03));
    } else if p.round == Some(true) || (footprint > 0.8 && h > 1.4 * w.max(d)) {
        m.add(whole(Shape::Lathe).oval().points(&[
            [0.85, 0.0],
            [0.9, 0.03],
            [1.0, 0.4],
            [0.9, 0.85],
            [0.7, 0.98],
            [0.0, 1.0],
        ]));
    } else {
        m.add(whole(Shape::Box).round(0.06 * m.smallest));
    }
}

#[cfg(test)]
mod tests;
