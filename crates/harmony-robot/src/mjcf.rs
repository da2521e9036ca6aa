//! Reads a robot from MuJoCo's XML.
//!
//! Read are bodies with `pos` and `quat`, one hinge or slide a body with its range, a free joint at the root, inertials,
//! geoms (mesh, box, capsule, cylinder, sphere), materials' colours, default classes, mesh files and the first keyframe.
//! Actuators, tendons, sensors, equalities and contact pairs are not: they say nothing about where a robot can be.
//! A pose given otherwise (`euler`, `axisangle`, ...) is an error, never a guess.
//!
//! # Source
//! MuJoCo's XML reference, version 4.0.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{DAffine3, DMat3, DQuat, DVec3, Vec3};
use harmony_io::read_bounded;
use harmony_mesh::Mesh;
use roxmltree::{Document, Node};

use crate::RobotError;
use crate::meshes;
use crate::model::{Form, Geom, Joint, JointKind, Link, Model};

/// Largest model file, bytes.
const LARGEST: u64 = 16 << 20;
/// Colour of what has none.
const GREY: [f32; 3] = [0.5; 3];

impl Model {
    /// Reads an MJCF file with its meshes.
    ///
    /// # Errors
    /// [`RobotError`], naming the file, the mesh or the joint.
    pub fn read(path: &Path) -> Result<Self, RobotError> {
        let bytes = read_bounded(path, LARGEST)?;
        let bad = |why: String| RobotError::Model { path: path.to_owned(), why };
        let text = String::from_utf8(bytes).map_err(|_| bad("it is no text".to_owned()))?;
        let document = Document::parse(&text).map_err(|e| bad(e.to_string()))?;
        let root = document.root_element();
        if root.tag_name().name() != "mujoco" {
            return Err(bad(format!("its root is <{}>, not <mujoco>", root.tag_name().name())));
        }
        Reader::new(path, root)?.model(root)
    }
}

/// Attributes of a default class, by element.
type Class = BTreeMap<String, BTreeMap<String, String>>;

struct Reader<'a> {
    path: &'a Path,
    classes: BTreeMap<String, Class>,
    meshes: BTreeMap<String, (PathBuf, Vec3)>,
    read: BTreeMap<String, Arc<Mesh>>,
    colors: BTreeMap<String, [f32; 3]>,
    degrees: bool,
    auto_limits: bool,
    model: Model,
}

impl<'a> Reader<'a> {
    fn new(path: &'a Path, root: Node<'_, '_>) -> Result<Self, RobotError> {
        let compiler = child(root, "compiler");
        let of = |name: &str| compiler.and_then(|c| c.attribute(name)).unwrap_or_default();
        let folder = path.parent().unwrap_or(Path::new(".")).join(of("meshdir"));
        let mut reader = Self {
            path,
            classes: BTreeMap::from([("main".to_owned(), Class::new())]),
            meshes: BTreeMap::new(),
            read: BTreeMap::new(),
            colors: BTreeMap::new(),
            degrees: of("angle") != "radian",
            auto_limits: of("autolimits") != "false",
            model: Model {
                name: root.attribute("model").unwrap_or("robot").to_owned(),
                links: vec![],
                joints: vec![],
                floating: false,
                home: None,
            },
        };
        for default in root.children().filter(|n| n.has_tag_name("default")) {
            reader.class(default, &Class::new(), "main");
        }
        for asset in root.children().filter(|n| n.has_tag_name("asset")) {
            for mesh in asset.children().filter(|n| n.has_tag_name("mesh")) {
                let file = mesh.attribute("file").ok_or_else(|| reader.bad(mesh, "a mesh without a file"))?;
                let stem = Path::new(file).file_stem().map_or_else(String::new, |s| s.to_string_lossy().into_owned());
                let name = mesh.attribute("name").map_or(stem, ToOwned::to_owned);
                let scale = reader.vector(mesh, mesh.attribute("scale"), DVec3::ONE)?;
                reader.meshes.insert(name, (folder.join(file), scale.as_vec3()));
            }
            for material in asset.children().filter(|n| n.has_tag_name("material")) {
                let rgba = reader.numbers(material, material.attribute("rgba").unwrap_or_default())?;
                if let (Some(name), [r, g, b, ..]) = (material.attribute("name"), &rgba[..]) {
                    reader.colors.insert(name.to_owned(), [*r as f32, *g as f32, *b as f32]);
                }
            }
        }
        Ok(reader)
    }

    fn bad(&self, node: Node<'_, '_>, what: &str) -> RobotError {
        let line = node.document().text_pos_at(node.range().start).row;
        RobotError::Model { path: self.path.to_owned(), why: format!("line {line}: {what}") }
    }

    /// Takes a default class and those in it.
    fn class(&mut self, node: Node<'_, '_>, parent: &Class, name: &str) {
        let name = node.attribute("class").unwrap_or(name).to_owned();
        let mut class = parent.clone();
        for element in node.children().filter(|n| n.is_element() && !n.has_tag_name("default")) {
            let of = class.entry(element.tag_name().name().to_owned()).or_default();
            of.extend(element.attributes().map(|a| (a.name().to_owned(), a.value().to_owned())));
        }
        for inner in node.children().filter(|n| n.has_tag_name("default")) {
            self.class(inner, &class, "main");
        }
        self.classes.insert(name, class);
    }

    /// An attribute of an element, else that of its class.
    fn attribute<'n>(&'n self, node: Node<'n, '_>, class: &str, name: &str) -> Option<&'n str> {
        let class = node.attribute("class").unwrap_or(class);
        node.attribute(name)
            .or_else(|| self.classes.get(class)?.get(node.tag_name().name())?.get(name).map(String::as_str))
    }

    fn numbers(&self, node: Node<'_, '_>, text: &str) -> Result<Vec<f64>, RobotError> {
        let all: Result<Vec<f64>, _> = text.split_ascii_whitespace().map(str::parse).collect();
        let all = all.map_err(|_| self.bad(node, &format!("\"{text}\" is no list of numbers")))?;
        if all.iter().all(|v| v.is_finite()) { Ok(all) } else { Err(self.bad(node, "a number is not finite")) }
    }

    fn vector(&self, node: Node<'_, '_>, text: Option<&str>, default: DVec3) -> Result<DVec3, RobotError> {
        let Some(text) = text else { return Ok(default) };
        match self.numbers(node, text)?[..] {
            [x, y, z] => Ok(DVec3::new(x, y, z)),
            _ => Err(self.bad(node, &format!("\"{text}\" has not three numbers"))),
        }
    }

    fn turn(&self, node: Node<'_, '_>, class: &str) -> Result<DQuat, RobotError> {
        for other in ["euler", "axisangle", "xyaxes", "zaxis"] {
            if self.attribute(node, class, other).is_some() {
                return Err(self.bad(node, &format!("a turn by {other} is not read, give a quat")));
            }
        }
        let Some(text) = self.attribute(node, class, "quat") else { return Ok(DQuat::IDENTITY) };
        match self.numbers(node, text)?[..] {
            [w, x, y, z] if w * w + x * x + y * y + z * z > 1e-12 => Ok(DQuat::from_xyzw(x, y, z, w).normalize()),
            _ => Err(self.bad(node, &format!("\"{text}\" is no quaternion"))),
        }
    }

    fn place(&self, node: Node<'_, '_>, class: &str) -> Result<DAffine3, RobotError> {
        let at = self.vector(node, self.attribute(node, class, "pos"), DVec3::ZERO)?;
        Ok(DAffine3::from_rotation_translation(self.turn(node, class)?, at))
    }

    fn model(mut self, root: Node<'_, '_>) -> Result<Model, RobotError> {
        let world = child(root, "worldbody").ok_or_else(|| self.bad(root, "no worldbody"))?;
        let bodies: Vec<Node<'_, '_>> = world.children().filter(|n| n.has_tag_name("body")).collect();
        let [body] = bodies[..] else {
            return Err(self.bad(world, &format!("{} bodies at the root, one is needed", bodies.len())));
        };
        self.body(body, None, "main")?;
        if let Some(key) = child(root, "keyframe").and_then(|k| child(k, "key")) {
            let values = self.numbers(key, key.attribute("qpos").unwrap_or_default())?;
            let skip = if self.model.floating { 7 } else { 0 };
            self.model.home = values.get(skip..).filter(|v| v.len() == self.model.joints.len()).map(<[f64]>::to_vec);
        }
        Ok(self.model)
    }

    fn body(&mut self, node: Node<'_, '_>, parent: Option<usize>, class: &str) -> Result<(), RobotError> {
        let class = node.attribute("childclass").unwrap_or(class).to_owned();
        let number = self.model.links.len();
        let name = node.attribute("name").map_or_else(|| format!("body_{number}"), ToOwned::to_owned);
        let parent_from_link = self.place(node, &class)?;
        let mut link = Link {
            name,
            parent,
            parent_from_link,
            joint: None,
            mass: 0.0,
            centre: DVec3::ZERO,
            inertia: DMat3::ZERO,
            geoms: vec![],
        };
        if let Some(inertial) = child(node, "inertial") {
            self.inertial(inertial, &mut link)?;
        }
        for element in node.children().filter(Node::is_element) {
            match element.tag_name().name() {
                "freejoint" => self.free(element, parent)?,
                "joint" if self.attribute(element, &class, "type") == Some("free") => self.free(element, parent)?,
                "joint" => {
                    if link.joint.is_some() {
                        return Err(self.bad(element, &format!("{} has more than one joint", link.name)));
                    }
                    let joint = self.joint(element, &class, number)?;
                    link.joint = Some(self.model.joints.len());
                    self.model.joints.push(joint);
                }
                "geom" => {
                    let geom = self.geom(element, &class)?;
                    link.geoms.extend(geom);
                }
                _ => {}
            }
        }
        self.model.links.push(link);
        for inner in node.children().filter(|n| n.has_tag_name("body")) {
            self.body(inner, Some(number), &class)?;
        }
        Ok(())
    }

    fn free(&mut self, node: Node<'_, '_>, parent: Option<usize>) -> Result<(), RobotError> {
        if parent.is_some() {
            return Err(self.bad(node, "a free joint below the root"));
        }
        self.model.floating = true;
        Ok(())
    }

    fn inertial(&self, node: Node<'_, '_>, link: &mut Link) -> Result<(), RobotError> {
        link.mass = self.numbers(node, node.attribute("mass").unwrap_or_default())?.first().copied().unwrap_or(0.0);
        link.centre = self.vector(node, node.attribute("pos"), DVec3::ZERO)?;
        let turn = DMat3::from_quat(self.turn(node, "main")?);
        let full = node.attribute("fullinertia").map(|t| self.numbers(node, t)).transpose()?;
        let own = match full.as_deref() {
            Some(&[xx, yy, zz, xy, xz, yz]) => {
                DMat3::from_cols(DVec3::new(xx, xy, xz), DVec3::new(xy, yy, yz), DVec3::new(xz, yz, zz))
            }
            Some(_) => return Err(self.bad(node, "fullinertia has not six numbers")),
            None => DMat3::from_diagonal(self.vector(node, node.attribute("diaginertia"), DVec3::ZERO)?),
        };
        link.inertia = turn * own * turn.transpose();
        Ok(())
    }

    fn joint(&self, node: Node<'_, '_>, class: &str, link: usize) -> Result<Joint, RobotError> {
        let name = node.attribute("name").map_or_else(|| format!("joint_{link}"), ToOwned::to_owned);
        let kind = match self.attribute(node, class, "type") {
            None | Some("hinge") => JointKind::Hinge,
            Some("slide") => JointKind::Slide,
            Some(other) => return Err(self.bad(node, &format!("joint {name} is a {other}, which is not read"))),
        };
        let axis = self.vector(node, self.attribute(node, class, "axis"), DVec3::Z)?;
        let axis = axis.try_normalize().ok_or_else(|| self.bad(node, &format!("joint {name} has no axis")))?;
        let anchor = self.vector(node, self.attribute(node, class, "pos"), DVec3::ZERO)?;
        let range = self.numbers(node, self.attribute(node, class, "range").unwrap_or_default())?;
        let limited = match self.attribute(node, class, "limited") {
            Some("true") => true,
            Some("false") => false,
            _ => self.auto_limits,
        };
        let range = match range[..] {
            [low, high] if limited && low < high => [low, high],
            _ => return Err(RobotError::NoLimits { joint: name }),
        };
        let degrees = self.degrees && kind == JointKind::Hinge;
        let range = if degrees { range.map(f64::to_radians) } else { range };
        Ok(Joint { name, kind, axis, anchor, range, link })
    }

    /// A geom; `None` for what has no form here (planes, sites of sensors).
    fn geom(&mut self, node: Node<'_, '_>, class: &str) -> Result<Option<Geom>, RobotError> {
        let of = |name: &str| self.attribute(node, class, name).map(ToOwned::to_owned);
        let (mesh, kind) = (of("mesh"), of("type"));
        let kind = kind.unwrap_or_else(|| if mesh.is_some() { "mesh".to_owned() } else { "sphere".to_owned() });
        let size = self.numbers(node, &of("size").unwrap_or_default())?;
        let visual = of("contype").as_deref() == Some("0") && of("conaffinity").as_deref() == Some("0");
        let color = of("material").and_then(|m| self.colors.get(&m).copied());
        let rgba = self.numbers(node, &of("rgba").unwrap_or_default())?;
        let color = color.or(rgba.get(..3).map(|c| [c[0] as f32, c[1] as f32, c[2] as f32])).unwrap_or(GREY);
        let mut link_from_geom = self.place(node, class)?;
        let mut half = size.get(1).copied();
        if let Some(text) = of("fromto") {
            let [ax, ay, az, bx, by, bz] = self.numbers(node, &text)?[..] else {
                return Err(self.bad(node, "fromto has not six numbers"));
            };
            let (a, b) = (DVec3::new(ax, ay, az), DVec3::new(bx, by, bz));
            let turn = DQuat::from_rotation_arc(DVec3::Z, (b - a).normalize_or(DVec3::Z));
            link_from_geom = DAffine3::from_rotation_translation(turn, (a + b) / 2.0);
            half = Some(a.distance(b) / 2.0);
        }
        let few = || self.bad(node, &format!("a {kind} of too few sizes"));
        let first = size.first().copied();
        let form = match kind.as_str() {
            "mesh" => {
                let name = mesh.ok_or_else(|| self.bad(node, "a mesh geom without a mesh"))?;
                Form::Mesh(self.mesh(node, &name)?)
            }
            "box" => match size[..] {
                [x, y, z] => Form::Box(DVec3::new(x, y, z)),
                _ => return Err(few()),
            },
            "capsule" => Form::Capsule(first.ok_or_else(few)?, half.ok_or_else(few)?),
            "cylinder" => Form::Cylinder(first.ok_or_else(few)?, half.ok_or_else(few)?),
            "sphere" => Form::Sphere(first.ok_or_else(few)?),
            _ => return Ok(None),
        };
        Ok(Some(Geom { link_from_geom, form, visual, color }))
    }

    fn mesh(&mut self, node: Node<'_, '_>, name: &str) -> Result<Arc<Mesh>, RobotError> {
        if let Some(known) = self.read.get(name) {
            return Ok(Arc::clone(known));
        }
        let Some((path, scale)) = self.meshes.get(name) else {
            return Err(self.bad(node, &format!("the mesh {name} is not among the assets")));
        };
        let mesh = Arc::new(meshes::read(name, path, *scale)?);
        self.read.insert(name.to_owned(), Arc::clone(&mesh));
        Ok(mesh)
    }
}

fn child<'a, 'i>(node: Node<'a, 'i>, name: &str) -> Option<Node<'a, 'i>> {
    node.children().find(|n| n.has_tag_name(name))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn model(text: &str) -> Result<Model, RobotError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("robot.xml");
        std::fs::write(&path, text).unwrap();
        Model::read(&path)
    }

    fn two(joint: &str) -> String {
        format!(
            "<mujoco model=\"two\"><compiler angle=\"degree\"/><default><default class=\"a\"><joint axis=\"0 1 0\"/>\
             <default class=\"b\"><geom type=\"capsule\" size=\"0.1\"/></default></default></default><worldbody>\
             <body name=\"root\" childclass=\"a\"><freejoint/><body name=\"leg\" pos=\"0 0 -1\" quat=\"1 0 0 1\">\
             <inertial mass=\"2\" pos=\"0 0 1\" diaginertia=\"1 2 3\"/>{joint}\
             <geom class=\"b\" fromto=\"0 0 0 0 0 -2\"/></body></body></worldbody></mujoco>"
        )
    }

    #[test]
    fn classes_angles_and_turns_are_those_of_the_file() {
        let model = model(&two("<joint name=\"knee\" range=\"-90 45\"/>")).unwrap();
        assert!(model.floating && model.links.len() == 2);
        let knee = &model.joints[0];
        assert_eq!((knee.axis, knee.link), (DVec3::Y, 1), "the axis is the class's");
        assert!((knee.range[1] - std::f64::consts::FRAC_PI_4).abs() < 1e-12, "degrees");
        let leg = &model.links[1];
        let turned = leg.parent_from_link.transform_vector3(DVec3::X);
        assert!(turned.distance(DVec3::Y) < 1e-12, "a quarter turn: {turned}");
        let Form::Capsule(radius, half) = leg.geoms[0].form else { panic!("{:?}", leg.geoms) };
        assert_eq!((radius, half), (0.1, 1.0));
        assert!(leg.geoms[0].link_from_geom.translation.distance(DVec3::NEG_Z) < 1e-12);
    }

    #[test]
    fn what_is_missing_is_named() {
        let none = model(&two("<joint name=\"knee\"/>")).unwrap_err();
        assert!(matches!(&none, RobotError::NoLimits { joint } if joint == "knee"), "{none}");
        let free = model(&two("<joint name=\"knee\" limited=\"false\" range=\"-1 1\"/>")).unwrap_err();
        assert!(matches!(free, RobotError::NoLimits { .. }));
        let mesh = "<mujoco><asset><mesh file=\"arm.stl\"/></asset><worldbody><body name=\"a\">\
                    <geom type=\"mesh\" mesh=\"arm\"/></body></worldbody></mujoco>";
        let said = model(mesh).unwrap_err();
        assert!(matches!(&said, RobotError::NoMesh { mesh, .. } if mesh == "arm"), "{said}");
        let said = model("<robot/>").unwrap_err().to_string();
        assert!(said.contains("<robot>"), "{said}");
        assert!(model("<mujoco><worldbody/></mujoco>").is_err());
        let said = model(&two("<joint name=\"knee\" type=\"ball\" range=\"0 1\"/>")).unwrap_err().to_string();
        assert!(said.contains("knee") && said.contains("ball"), "{said}");
    }
}
