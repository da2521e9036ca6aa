//! The stage.

use glam::{DAffine3, DMat3, DVec3};
use harmony_physics::Bodies;
use harmony_scene::{Level, Light, LightKind, Lighting};

use super::physics::{self, Frictions, ROOM_FRICTION};
use super::text::{Text, quoted, schemas, tuple};
use crate::World;
use crate::moving;
use crate::text::num;
use crate::world::{Item, Look, Piece, Select, identifier, z_up, z_up_f32, z_up_rotation};

/// Width of the camera's film; only ratios count.
const FILM: f64 = 36.0;

/// Name of a level's group.
pub(crate) fn level_name(level: Level) -> &'static str {
    match level {
        Level::Wall => "wall",
        Level::Furniture => "furniture",
        Level::Ceiling => "ceiling",
        Level::Decoration => "decoration",
    }
}

/// The whole stage as text.
pub(crate) fn stage(world: &World, bodies: &Bodies) -> String {
    let doc = format!("HARMONY scene ({}), one photo's room", world.scene.generator);
    let mut t = Text::new(&format!(
        "(\n    defaultPrim = \"World\"\n    doc = {}\n    kilogramsPerUnit = 1\n    metersPerUnit = 1\n    upAxis = \"Z\"\n)\n",
        quoted(&doc)
    ));
    let frictions = Frictions::of(bodies);
    t.prim("Xform", "World", &["kind = \"assembly\"".to_owned()], |t| {
        t.prim("PhysicsScene", "physics", &[], |t| {
            t.line("vector3f physics:gravityDirection = (0, 0, -1)");
            t.line("float physics:gravityMagnitude = 9.81");
        });
        t.prim("Scope", "Looks", &[], |t| {
            for look in &world.looks.looks {
                material(t, world, look);
            }
            frictions.write(t);
        });
        t.prim("Xform", "room", &["kind = \"component\"".to_owned()], |t| room(t, world, bodies, &frictions));
        for level in Level::ALL {
            if world.level(level).next().is_none() {
                continue;
            }
            t.prim("Xform", level_name(level), &["kind = \"group\"".to_owned()], |t| {
                for (item, body) in world.items.iter().zip(&bodies.objects).filter(|(i, _)| i.object.level == level) {
                    object(t, world, item, body, &frictions);
                }
            });
        }
        t.prim("Xform", "lights", &[], |t| lights(t, world, bodies));
        camera(t, world);
    });
    t.finish()
}

fn room(t: &mut Text, world: &World, bodies: &Bodies, frictions: &Frictions) {
    for face in &world.shell {
        t.prim("Xform", &face.name, &[], |t| {
            t.prim("Xform", "visual", &[], |t| {
                for piece in world.face_pieces(face) {
                    mesh(t, world, &piece);
                }
            });
            let hulls = bodies.shell.iter().find(|(name, _)| *name == face.name);
            if let Some((_, hulls)) = hulls.filter(|(_, hulls)| !hulls.is_empty()) {
                let material = frictions.path(ROOM_FRICTION, 0.0);
                t.prim("Xform", "collision", &[], |t| physics::colliders(t, hulls, &material));
            }
        });
    }
}

fn object(t: &mut Text, world: &World, item: &Item, body: &harmony_physics::Body, frictions: &Frictions) {
    let o = &item.object;
    let mut metadata = vec!["kind = \"component\"".to_owned()];
    let applied = physics::body_schemas(body);
    if !applied.is_empty() {
        metadata.push(schemas(&applied));
    }
    metadata.push("customData = {".to_owned());
    for (name, value) in
        [("label", o.label.clone()), ("description", o.description.clone()), ("mesh_source", o.mesh_source.clone())]
    {
        metadata.push(format!("    string {name} = {}", quoted(&value.chars().take(400).collect::<String>())));
    }
    metadata.push(format!("    double confidence = {}", num(o.confidence.overall, 4)));
    metadata.push(format!("    double mass_kg = {}", num(body.mass_kg, 6)));
    metadata.push("}".to_owned());
    let material = frictions.path(body.friction, body.restitution);
    let place = |t: &mut Text| {
        let p = z_up(o.pose.position);
        t.line(&format!("double3 xformOp:translate = {}", tuple(&p.to_array(), 6)));
        t.line(&format!("double xformOp:rotateZ = {}", num(o.pose.yaw.to_degrees(), 6)));
        t.line("uniform token[] xformOpOrder = [\"xformOp:translate\", \"xformOp:rotateZ\"]");
    };
    let (parts, rest) = moving::parts(item, body);
    let fixed = |t: &mut Text| {
        physics::body(t, body, rest);
        t.prim("Xform", "visual", &[], |t| {
            for piece in world.selected_pieces(item, Select::Fixed) {
                mesh(t, world, &piece);
            }
        });
        t.prim("Xform", "collision", &[], |t| physics::colliders(t, &body.hulls, &material));
        own_lights(t, world, item, body);
    };
    if parts.is_empty() {
        t.prim("Xform", item.name(), &metadata, |t| {
            place(t);
            fixed(t);
        });
        return;
    }
    // Bodies are never nested: what moves and what it moves against stand beside each other.
    let applied: Vec<String> = metadata.iter().filter(|m| m.starts_with("prepend apiSchemas")).cloned().collect();
    metadata.retain(|m| !m.starts_with("prepend apiSchemas"));
    t.prim("Xform", item.name(), &metadata, |t| {
        place(t);
        t.prim("Xform", "body", &applied, fixed);
        for part in &parts {
            t.prim("Xform", &part.part.name, &[schemas(&["PhysicsRigidBodyAPI", "PhysicsMassAPI"])], |t| {
                physics::part(t, part);
                t.prim("Xform", "visual", &[], |t| {
                    for piece in world.selected_pieces(item, Select::Part(part.number)) {
                        mesh(t, world, &piece);
                    }
                });
                t.prim("Xform", "collision", &[], |t| {
                    physics::colliders(t, std::slice::from_ref(&part.hull), &material);
                });
            });
            physics::joint(t, &format!("/World/{}/{}", level_name(o.level), item.name()), part);
        }
    });
}

fn mesh(t: &mut Text, world: &World, piece: &Piece) {
    let look = &world.looks.looks[piece.look];
    t.prim("Mesh", &look.name, &[schemas(&["MaterialBindingAPI"])], |t| {
        let points = || piece.positions.iter().map(|p| z_up_f32(*p).as_dvec3().to_array());
        let (low, high) = points().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), p| {
            (l.min(DVec3::from_array(p)), h.max(DVec3::from_array(p)))
        });
        if look.material.double_sided {
            t.line("uniform bool doubleSided = 1");
        }
        t.tuples("float3[] extent", [low.to_array(), high.to_array()].into_iter(), 5, "");
        t.whole("int[] faceVertexCounts", piece.triangles.iter().map(|_| 3));
        t.whole("int[] faceVertexIndices", piece.triangles.iter().flatten().map(|i| *i as usize));
        t.tuples("point3f[] points", points(), 5, "");
        let normals = piece.normals.iter().map(|n| z_up_f32(*n).as_dvec3().to_array());
        t.tuples("normal3f[] normals", normals, 4, " (\n        interpolation = \"vertex\"\n    )");
        if look.color.is_some() || look.normal.is_some() || look.surface.is_some() {
            // Rows of images run down from v = 1.
            let st = piece.uvs.iter().map(|uv| [f64::from(uv.x), 1.0 - f64::from(uv.y)]);
            t.tuples("texCoord2f[] primvars:st", st, 5, " (\n        interpolation = \"vertex\"\n    )");
        }
        t.line("uniform token subdivisionScheme = \"none\"");
        t.line(&format!("rel material:binding = </World/Looks/{}>", look.name));
    });
}

fn material(t: &mut Text, world: &World, look: &Look) {
    let path = format!("/World/Looks/{}", look.name);
    let m = &look.material;
    let base = [m.base_color[0], m.base_color[1], m.base_color[2]].map(f64::from);
    t.prim("Material", &look.name, &[], |t| {
        t.line(&format!("token outputs:surface.connect = <{path}/Surface.outputs:surface>"));
        t.prim("Shader", "Surface", &[], |t| {
            t.line("uniform token info:id = \"UsdPreviewSurface\"");
            let opacity = num(look.opacity(), 4);
            if let Some(color) = look.color {
                t.line(&format!("color3f inputs:diffuseColor.connect = <{path}/Color.outputs:rgb>"));
                if world.looks.pictures[color].alpha {
                    t.line(&format!("float inputs:opacity.connect = <{path}/Color.outputs:a>"));
                } else {
                    t.line(&format!("float inputs:opacity = {opacity}"));
                }
            } else {
                t.line(&format!("color3f inputs:diffuseColor = {}", tuple(&base, 5)));
                t.line(&format!("float inputs:opacity = {opacity}"));
            }
            let (roughness, metallic) = (num(m.roughness.into(), 4), num(m.metallic.into(), 4));
            if look.surface.is_some() {
                t.line(&format!("float inputs:occlusion.connect = <{path}/Maps.outputs:r>"));
                t.line(&format!("float inputs:roughness.connect = <{path}/Maps.outputs:g>"));
                t.line(&format!("float inputs:metallic.connect = <{path}/Maps.outputs:b>"));
            } else {
                t.line(&format!("float inputs:roughness = {roughness}"));
                t.line(&format!("float inputs:metallic = {metallic}"));
            }
            if look.normal.is_some() {
                t.line(&format!("normal3f inputs:normal.connect = <{path}/Normals.outputs:rgb>"));
            }
            t.line(&format!("float inputs:ior = {}", num(m.ior.into(), 4)));
            if m.emissive.iter().any(|e| *e > 0.0) {
                t.line(&format!("color3f inputs:emissiveColor = {}", tuple(&m.emissive.map(f64::from), 5)));
            }
            t.line("token outputs:surface");
        });
        if look.color.is_none() && look.normal.is_none() && look.surface.is_none() {
            return;
        }
        t.prim("Shader", "Coordinates", &[], |t| {
            t.line("uniform token info:id = \"UsdPrimvarReader_float2\"");
            t.line("string inputs:varname = \"st\"");
            t.line("float2 outputs:result");
        });
        let mut texture =
            |name: &str, picture: usize, space: &str, scale: [f64; 4], bias: [f64; 4], outputs: &[&str]| {
                t.prim("Shader", name, &[], |t| {
                    t.line("uniform token info:id = \"UsdUVTexture\"");
                    t.line(&format!("asset inputs:file = @./textures/{}@", world.looks.pictures[picture].small_name()));
                    t.line(&format!("token inputs:sourceColorSpace = \"{space}\""));
                    t.line("token inputs:wrapS = \"repeat\"");
                    t.line("token inputs:wrapT = \"repeat\"");
                    t.line(&format!("float4 inputs:scale = {}", tuple(&scale, 5)));
                    if bias != [0.0; 4] {
                        t.line(&format!("float4 inputs:bias = {}", tuple(&bias, 5)));
                    }
                    t.line(&format!("float2 inputs:st.connect = <{path}/Coordinates.outputs:result>"));
                    for output in outputs {
                        t.line(output);
                    }
                });
            };
        if let Some(color) = look.color {
            let scale = [base[0], base[1], base[2], look.opacity()];
            texture("Color", color, "sRGB", scale, [0.0; 4], &["float3 outputs:rgb", "float outputs:a"]);
        }
        if let Some(normal) = look.normal {
            texture("Normals", normal, "raw", [2.0, 2.0, 2.0, 1.0], [-1.0, -1.0, -1.0, 0.0], &["float3 outputs:rgb"]);
        }
        if let Some(surface) = look.surface {
            let scale = [1.0, f64::from(m.roughness), f64::from(m.metallic), 1.0];
            texture(
                "Maps",
                surface,
                "raw",
                scale,
                [0.0; 4],
                &["float outputs:r", "float outputs:g", "float outputs:b"],
            );
        }
    });
}

/// A matrix as USD has it: rows are the images of the axes, the translation in the last one.
pub(super) fn matrix(axes: DMat3, at: DVec3) -> String {
    let row = |v: DVec3, w: f64| tuple(&[v.x, v.y, v.z, w], 9);
    format!("( {}, {}, {}, {} )", row(axes.x_axis, 0.0), row(axes.y_axis, 0.0), row(axes.z_axis, 0.0), row(at, 1.0))
}

fn place(t: &mut Text, axes: DMat3, at: DVec3) {
    t.line(&format!("matrix4d xformOp:transform = {}", matrix(axes, at)));
    t.line("uniform token[] xformOpOrder = [\"xformOp:transform\"]");
}

/// Lights that stand in the room; those of things that move stand below them.
fn lights(t: &mut Text, world: &World, bodies: &Bodies) {
    let lighting = &world.scene.lighting;
    let mut taken = std::collections::BTreeSet::new();
    for light in moving::still_lights(world, bodies) {
        light_prim(t, lighting, light, &free_name(&mut taken, &light.id), &DAffine3::IDENTITY);
    }
    if lighting.ambient_intensity > 0.0 {
        let name = free_name(&mut taken, "ambient");
        t.prim("DomeLight", &name, &[], |t| {
            t.line(&format!("color3f inputs:color = {}", tuple(&lighting.ambient_color.map(|c| c.clamp(0.0, 1.0)), 5)));
            t.line(&format!("float inputs:intensity = {}", num(lighting.ambient_intensity, 6)));
            t.line(&format!("float inputs:exposure = {}", num(lighting.exposure.clamp(-30.0, 30.0), 5)));
        });
    }
}

/// A name that nothing beside it has.
fn free_name(taken: &mut std::collections::BTreeSet<String>, wanted: &str) -> String {
    let mut name = identifier(wanted);
    while !taken.insert(name.clone()) {
        name.push('_');
    }
    name
}

/// A light in a frame of the room.
fn light_prim(t: &mut Text, lighting: &Lighting, light: &Light, name: &str, room_from_frame: &DAffine3) {
    let (kind, own, axes) = kind_of(light);
    t.prim(kind, name, &[], |t| {
        t.line(&format!("color3f inputs:color = {}", tuple(&light.color.map(|c| c.clamp(0.0, 1.0)), 5)));
        let per_watt = if matches!(light.kind, LightKind::Sun { .. }) { 1.0 } else { std::f64::consts::FRAC_1_PI };
        t.line(&format!("float inputs:intensity = {}", num(light.intensity.max(0.0) * per_watt, 6)));
        t.line(&format!("float inputs:exposure = {}", num(lighting.exposure.clamp(-30.0, 30.0), 5)));
        t.line("bool inputs:normalize = 1");
        for line in &own {
            t.line(line);
        }
        if !light.on {
            t.line("token visibility = \"invisible\"");
        }
        let frame_from_room = room_from_frame.inverse();
        let at = frame_from_room.transform_point3(DVec3::from_array(light.position));
        place(t, z_up_rotation(frame_from_room.matrix3) * axes, z_up(at));
    });
}

/// Lights that an object takes along, in its frame.
fn own_lights(t: &mut Text, world: &World, item: &Item, body: &harmony_physics::Body) {
    let room_from_body = DAffine3::from_mat3_translation(item.rotation(), item.object.pose.position);
    let mut taken = ["visual", "collision"].map(str::to_owned).into_iter().collect();
    for light in moving::lights(world, item, body) {
        light_prim(t, &world.scene.lighting, light, &free_name(&mut taken, &light.id), &room_from_body);
    }
}

fn kind_of(light: &Light) -> (&'static str, Vec<String>, DMat3) {
    match &light.kind {
        LightKind::Point { radius_m } => {
            let radius = if radius_m.is_finite() { radius_m.clamp(1e-3, 10.0) } else { 0.03 };
            ("SphereLight", vec![format!("float inputs:radius = {}", num(radius, 5))], DMat3::IDENTITY)
        }
        LightKind::Area { direction, size_m } => {
            let size = size_m.map(|s| if s.is_finite() { s.clamp(1e-3, 100.0) } else { 1.0 });
            let own = vec![
                format!("float inputs:width = {}", num(size[0], 5)),
                format!("float inputs:height = {}", num(size[1], 5)),
            ];
            ("RectLight", own, towards(DVec3::from_array(*direction)))
        }
        LightKind::Sun { direction } => {
            ("DistantLight", vec!["float inputs:angle = 0.53".to_owned()], towards(DVec3::from_array(*direction)))
        }
    }
}

/// Axes (+Z up) of what shines along its local -Z towards a direction of the room, its x level.
fn towards(direction: DVec3) -> DMat3 {
    let back = -z_up(direction).normalize_or(DVec3::NEG_Z);
    let x = DVec3::Z.cross(back).try_normalize().unwrap_or(DVec3::X);
    DMat3::from_cols(x, back.cross(x), back)
}

fn camera(t: &mut Text, world: &World) {
    let c = &world.camera;
    let k = &c.intrinsics;
    let (w, h) = (f64::from(c.size.width), f64::from(c.size.height));
    let focal = k.fx / w * FILM;
    t.prim("Camera", "camera", &[], |t| {
        t.line("token projection = \"perspective\"");
        t.line(&format!("float focalLength = {}", num(focal, 6)));
        t.line(&format!("float horizontalAperture = {}", num(FILM, 6)));
        t.line(&format!("float verticalAperture = {}", num(h / k.fy * focal, 6)));
        t.line(&format!("float horizontalApertureOffset = {}", num((w / 2.0 - k.cx) / k.fx * focal, 6)));
        t.line(&format!("float verticalApertureOffset = {}", num((k.cy - h / 2.0) / k.fy * focal, 6)));
        t.line("float2 clippingRange = (0.02, 1000)");
        let axes = DMat3::from_cols(z_up(c.right()), z_up(-c.down()), z_up(-c.forward()));
        place(t, axes, z_up(c.centre()));
    });
}
