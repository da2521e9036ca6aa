//! Part models as a mesh generator.

use std::sync::Arc;

use async_trait::async_trait;
use harmony_imaging::color::median_color;
use harmony_mesh::{BuiltModel, PartModel, PartModelError, TextureMode, template, template_name};
use harmony_roles::{GeneratedMesh, MeshFrame, MeshGenerator, MeshRequest, PlayerCard, RoleError, Usage};
use harmony_scene::{ImageSize, Mask, Size};
use image::{Rgb, RgbImage, RgbaImage};

/// Alpha from which a crop's pixel belongs to the object.
const OBJECT_ALPHA: u8 = 128;

/// Builds the part model that came with the request; else the template that was chosen; else the label's template;
/// else a rounded body of the size asked for. What was approximated is told in the notes.
#[derive(Debug, Clone, Copy)]
pub struct PartModels;

#[async_trait]
impl MeshGenerator for PartModels {
    fn card(&self) -> PlayerCard {
        super::card("part models 1")
    }

    fn makes_shapes(&self) -> bool {
        false
    }

    async fn generate(&self, request: &MeshRequest) -> Result<GeneratedMesh, RoleError> {
        let request = request.clone();
        super::computed(move || build(&request)).await?
    }
}

fn build(request: &MeshRequest) -> Result<GeneratedMesh, RoleError> {
    let mut notes = Vec::new();
    if let Some(model) = &request.part_model {
        match built(model, request.size) {
            Ok(done) => return Ok(finished(done, model.clone(), "part model".to_owned(), notes)),
            Err(error) => notes.push(format!("the part model can't be built ({error}); a template was used")),
        }
    }
    let (name, known) = match (request.template.as_deref().and_then(template_name), template_name(&request.label)) {
        (Some(chosen), _) => (chosen.to_owned(), true),
        (None, Some(own)) => (own.to_owned(), true),
        (None, None) => (request.label.clone(), false),
    };
    let source = if known {
        format!("template {name}")
    } else {
        notes.push(format!("there is no template for {:?}: it is a plain body of its size", request.label));
        "plain body".to_owned()
    };
    let params = request.params.with_label(&request.label);
    let usual = harmony_catalogue::default_size(&name);
    for (size, note) in [(request.size, None), (usual, Some("the size can't be built; a usual one was taken"))] {
        let mut model = template(&name, &params, size);
        colour(&mut model, request);
        if let Ok(done) = built(&model, size) {
            notes.extend(note.map(str::to_owned));
            return Ok(finished(done, model, source, notes));
        }
    }
    Err(super::not_capable(format!("no mesh can be built for {:?}", request.label)))
}

fn built(model: &PartModel, size: Size) -> Result<BuiltModel, PartModelError> {
    model.check()?;
    model.build(size)
}

fn finished(done: BuiltModel, model: PartModel, source: String, notes: Vec<String>) -> GeneratedMesh {
    GeneratedMesh {
        mesh: Arc::new(done.mesh),
        convex: Some(done.convex),
        frame: MeshFrame::Canonical,
        part_model: Some(model),
        source,
        notes,
        usage: Usage::default(),
    }
}

/// Gives the template's main slot the colour of the object's pixels, unless colours were chosen: faces that the photo
/// does not show then look like those that it shows.
fn colour(model: &mut PartModel, request: &MeshRequest) {
    if !request.params.colors.is_empty() {
        return;
    }
    let main = model.slot("body").or_else(|| model.slots.first());
    let Some(name) = main.filter(|slot| slot.texture == TextureMode::Photo).map(|slot| slot.name.clone()) else {
        return;
    };
    if let Some(rgb) = object_color(&request.crop) {
        model.set_color(&name, rgb);
    }
}

/// Median colour of the crop's object pixels.
fn object_color(crop: &RgbaImage) -> Option<[u8; 3]> {
    let (width, height) = crop.dimensions();
    let rgb = RgbImage::from_fn(width, height, |x, y| {
        let [r, g, b, _] = crop.get_pixel(x, y).0;
        Rgb([r, g, b])
    });
    let mask = Mask::from_fn(ImageSize::new(width, height), |x, y| crop.get_pixel(x, y).0[3] >= OBJECT_ALPHA);
    median_color(&rgb, &mask)
}
