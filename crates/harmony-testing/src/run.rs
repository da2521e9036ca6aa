//! A run folder as tests need one: plain objects in a bare room, `scene.json` and `scene_full.glb`.

use std::path::Path;
use std::sync::Arc;

use harmony_io::{GlbNode, GlbScene, NodeTransform, TextureEncoding, write_glb, write_json};
use harmony_mesh::Mesh;
use harmony_scene::{
    Camera, Confidence, Extents, Level, Lighting, MaterialCategory, ObjectId, Physical, Pose, Relations, Room,
    RoomShape, SCENE_VERSION, Scene, SceneObject, Size, Support, SurfaceMaterial, ViewTransform,
};

/// A box without openings.
pub fn room(extents: Extents) -> Room {
    Room {
        room_type: "study".into(),
        extents,
        shape: RoomShape::default(),
        seen: vec![],
        openings: vec![],
        floor_texture: None,
        wall_texture: None,
    }
}

/// A thing of wood: furniture on the floor, decoration elsewhere.
///
/// # Panics
/// When the id is none.
pub fn object(id: &str, label: &str, pose: Pose, size: Size, support: Support) -> SceneObject {
    let level = if support == Support::Floor { Level::Furniture } else { Level::Decoration };
    let category = MaterialCategory::Wood;
    SceneObject {
        id: ObjectId::new(id).expect("an id"),
        index: 10,
        level,
        label: label.into(),
        description: String::new(),
        source_phrase: label.into(),
        pose,
        size,
        support,
        relations: Relations::default(),
        material: SurfaceMaterial {
            category,
            pbr: category.defaults(),
            physical: Physical { weight_kg: 0.0, thickness_m: 0.02, elasticity: 0.1, rigid: None },
        },
        mesh: String::new(),
        mask: None,
        seen_box: None,
        mesh_source: "test".into(),
        confidence: Confidence::default(),
    }
}

/// Objects in a room, in even light.
pub fn scene(room: Room, camera: &Camera, objects: Vec<SceneObject>) -> Scene {
    Scene {
        version: SCENE_VERSION,
        generator: "test".into(),
        room,
        camera: camera.into(),
        objects,
        lighting: Lighting {
            lights: vec![],
            ambient_color: [1.0; 3],
            ambient_intensity: 1.0,
            exposure: 0.0,
            view: ViewTransform::default(),
        },
        summary: String::new(),
        warnings: vec![],
    }
}

/// Writes `scene.json`, and `scene_full.glb` with the objects' canonical meshes in their order and the faces of a shell.
///
/// # Panics
/// When they cannot be written.
pub fn write(folder: &Path, scene: &Scene, meshes: &[Arc<Mesh>], shell: Vec<GlbNode>) {
    let node = |(object, mesh): (&SceneObject, &Arc<Mesh>)| GlbNode {
        name: object.id.to_string(),
        mesh: Arc::clone(mesh),
        transform: NodeTransform::from(&object.pose),
        extras: serde_json::Value::Null,
    };
    let glb = GlbScene {
        objects: scene.objects.iter().zip(meshes).map(node).collect(),
        shell,
        camera: Some(Camera::from(&scene.camera)),
        lighting: Some(&scene.lighting),
        generator: scene.generator.clone(),
        textures: TextureEncoding::Compact,
        ..GlbScene::default()
    };
    write_glb(&glb, &folder.join("scene_full.glb")).expect("scene_full.glb is written");
    write_json(&folder.join("scene.json"), scene).expect("scene.json is written");
}
