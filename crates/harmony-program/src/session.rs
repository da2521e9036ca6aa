//! What one run of a program has made so far: nodes, materials and how much of everything.
#![expect(unsafe_code, reason = "the derive of ProvidesStaticType writes an unsafe impl; nothing here does")]

use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};

use harmony_shape::MaterialSpec;
use harmony_shape::tree::{
    Kind, MAX_INSTANCES, MAX_MATERIALS, MAX_NODES, MAX_POINTS, Node, NodeId, Outline, Section, ShapeTree,
};
use starlark::any::ProvidesStaticType;

use crate::bounds::{self, Bounds};
use crate::error::Complaint;
use crate::{Inputs, Limits};

/// One run. Values of the language hold indices into it.
#[derive(Debug, ProvidesStaticType)]
pub(crate) struct Session {
    pub inputs: Inputs,
    pub limits: Limits,
    state: RefCell<State>,
}

#[derive(Debug, Default)]
struct State {
    nodes: Vec<Node>,
    bounds: Vec<Option<Bounds>>,
    /// Of each node: drawn leaves once copies are expanded, and about how many triangles they have.
    instances: Vec<u64>,
    triangles: Vec<u64>,
    materials: Vec<MaterialSpec>,
    node_points: usize,
    curve_points: u64,
    cloth: u64,
    cells: u64,
    places: u64,
    unseeded: u32,
}

fn too_many(what: &str, count: u64, max: u64, hint: &str) -> Complaint {
    Complaint::limit(format!("{count} {what}; at most {max} are allowed")).with_hint(hint)
}

impl Session {
    pub fn new(inputs: Inputs, limits: Limits) -> Self {
        Self { inputs, limits, state: RefCell::default() }
    }

    /// Adds a node.
    pub fn add(&self, node: Node) -> Result<NodeId, Complaint> {
        let mut state = self.state.borrow_mut();
        let id = NodeId(state.nodes.len() as u32);
        if state.nodes.len() >= MAX_NODES {
            return Err(too_many(
                "parts",
                MAX_NODES as u64 + 1,
                MAX_NODES as u64,
                "copy one with row(), grid() or along()",
            ));
        }
        state.node_points += points_of(&node.kind);
        if state.node_points > MAX_POINTS {
            return Err(too_many("points", state.node_points as u64, MAX_POINTS as u64, "use fewer points a curve"));
        }
        let drawn = |list: &[u64]| -> u64 {
            let of = |ids: &[NodeId]| ids.iter().map(|id| list[id.0 as usize]).fold(0, u64::saturating_add);
            match &node.kind {
                Kind::Copies { child, places } => of(&[*child]).saturating_mul(places.len() as u64),
                Kind::On { child, .. } | Kind::Against { child, .. } => of(&[*child]),
                Kind::Scatter { children, count, .. } => {
                    (of(children) / children.len().max(1) as u64).saturating_mul(u64::from(*count))
                }
                Kind::Drape { .. } | Kind::Fringe { .. } | Kind::Plant { .. } | Kind::Wicker { .. } => 0,
                kind => of(&kind.references()),
            }
        };
        let instances = drawn(&state.instances).max(1);
        if instances > MAX_INSTANCES {
            let hint = "fewer copies, or one part made of a pattern instead";
            return Err(too_many("copies", instances, MAX_INSTANCES, hint));
        }
        let triangles = drawn(&state.triangles).saturating_add(own_triangles(&node.kind));
        if triangles > self.limits.triangles {
            let what = "triangles (estimated)";
            return Err(too_many(what, triangles, self.limits.triangles, "fewer copies, or plainer ones"));
        }
        if let Kind::Drape { size, .. } = &node.kind {
            state.cloth += cloth_particles(*size);
            if state.cloth > self.limits.cloth {
                return Err(too_many("particles of draped cloth", state.cloth, self.limits.cloth, "drape less cloth"));
            }
        }
        let bounds = bounds::of(&node.kind, &|id| state.bounds[id.0 as usize]);
        state.nodes.push(node);
        state.bounds.push(bounds);
        state.instances.push(instances);
        state.triangles.push(triangles);
        Ok(id)
    }

    /// A node's bounds, where they are known.
    pub fn bounds(&self, id: NodeId) -> Option<Bounds> {
        self.state.borrow().bounds[id.0 as usize]
    }

    /// Looks at a node.
    pub fn with_node<T>(&self, id: NodeId, look: impl FnOnce(&Node) -> T) -> T {
        look(&self.state.borrow().nodes[id.0 as usize])
    }

    /// Gives a node a name if it has none; whether it has this name now.
    pub fn name(&self, id: NodeId, name: &str) -> bool {
        let mut state = self.state.borrow_mut();
        let node = &mut state.nodes[id.0 as usize];
        match &node.name {
            None => {
                node.name = Some(name.to_owned());
                true
            }
            Some(own) => own == name,
        }
    }

    /// Adds a material; the same one again is the first one.
    pub fn material(&self, spec: MaterialSpec) -> Result<u32, Complaint> {
        let mut state = self.state.borrow_mut();
        if let Some(at) = state.materials.iter().position(|m| *m == spec) {
            return Ok(at as u32);
        }
        // Some more than a tree may have: what is not used is dropped in the end.
        if state.materials.len() >= 4 * MAX_MATERIALS {
            let max = 4 * MAX_MATERIALS as u64;
            return Err(too_many("materials", max + 1, max, "make materials outside loops"));
        }
        state.materials.push(spec);
        Ok(state.materials.len() as u32 - 1)
    }

    /// Looks at a material.
    pub fn with_material<T>(&self, index: u32, look: impl FnOnce(&MaterialSpec) -> T) -> T {
        look(&self.state.borrow().materials[index as usize])
    }

    /// Counts points of curves and outlines.
    pub fn charge_points(&self, count: usize) -> Result<(), Complaint> {
        let mut state = self.state.borrow_mut();
        state.curve_points += count as u64;
        let max = self.limits.curve_points;
        if state.curve_points > max {
            return Err(too_many("points of curves and outlines", state.curve_points, max, "fewer or shorter curves"));
        }
        Ok(())
    }

    /// Counts copies made one by one.
    pub fn charge_places(&self, count: u64) -> Result<(), Complaint> {
        let mut state = self.state.borrow_mut();
        state.places = state.places.saturating_add(count);
        if state.places > MAX_INSTANCES {
            return Err(too_many("copies", state.places, MAX_INSTANCES, "fewer copies"));
        }
        Ok(())
    }

    /// Counts calls of functions of the program by ours.
    pub fn charge_cells(&self, count: u64) -> Result<(), Complaint> {
        let mut state = self.state.borrow_mut();
        state.cells = state.cells.saturating_add(count);
        let max = self.limits.cells;
        if state.cells > max {
            return Err(too_many("cells of surf()", state.cells, max, "a coarser grid is smoothed anyway"));
        }
        Ok(())
    }

    /// A seed for a call that gives none: the number of such calls before it.
    pub fn next_seed(&self) -> u32 {
        let mut state = self.state.borrow_mut();
        state.unseeded += 1;
        state.unseeded
    }

    /// Whether a node is made of nothing but closed solids; otherwise what in it is not.
    pub fn open_part(&self, id: NodeId) -> Option<String> {
        let state = self.state.borrow();
        let mut waiting = vec![id];
        while let Some(id) = waiting.pop() {
            let node = &state.nodes[id.0 as usize];
            match &node.kind {
                Kind::Group { children } => waiting.extend(children),
                Kind::Placed { child, .. } | Kind::Copies { child, .. } | Kind::Paint { child, .. } => {
                    waiting.push(*child);
                }
                Kind::Shell { child, .. } | Kind::Joint { child, .. } | Kind::On { child, .. } => waiting.push(*child),
                Kind::Boolean { a, b, .. } => waiting.extend([*a, *b]),
                Kind::Box { .. }
                | Kind::Cylinder { .. }
                | Kind::Sphere { .. }
                | Kind::Lathe { .. }
                | Kind::Extrude { .. }
                | Kind::Sweep { .. }
                | Kind::Loft { .. }
                | Kind::BentSheet { .. }
                | Kind::Mesh { .. }
                | Kind::Blend { .. }
                | Kind::Cushion { .. }
                | Kind::Pillow { .. } => {}
                Kind::Surf { thick, .. } if *thick > 0.0 => {}
                kind => return Some(describe(kind, node.name.as_deref(), node.line)),
            }
        }
        None
    }

    /// What a node is, in words: `cushion "seat" of line 4`.
    pub fn describe(&self, id: NodeId) -> String {
        self.with_node(id, |node| describe(&node.kind, node.name.as_deref(), node.line))
    }

    /// The tree under a root: what it does not reach is dropped, the rest keeps its order; numbers have nine decimals at
    /// most, so that they come back from JSON as they were. Each material has a name of its own: a mesh knows its slots
    /// by that.
    pub fn tree(&self, root: NodeId) -> Result<ShapeTree, Complaint> {
        let state = self.state.borrow();
        let mut used = vec![false; state.nodes.len()];
        let mut waiting = vec![root];
        while let Some(id) = waiting.pop() {
            if !std::mem::replace(&mut used[id.0 as usize], true) {
                waiting.extend(state.nodes[id.0 as usize].kind.references());
            }
        }
        let mut new_id = BTreeMap::new();
        let mut new_material = BTreeMap::new();
        let mut tree = ShapeTree::default();
        for (i, node) in state.nodes.iter().enumerate().filter(|(i, _)| used[*i]) {
            let mut node = node.clone();
            map_nodes(&mut node.kind, &|id| new_id.get(&id).copied().unwrap_or(id));
            let mut material = |index: &mut u32| {
                *index = *new_material.entry(*index).or_insert_with(|| {
                    tree.materials.push(state.materials[*index as usize].clone());
                    tree.materials.len() as u32 - 1
                });
            };
            if let Some(index) = &mut node.material {
                material(index);
            }
            match &mut node.kind {
                Kind::Paint { with, .. } | Kind::Decal { with, .. } => material(with),
                Kind::Plant { flower: Some(flower), .. } => material(flower),
                _ => {}
            }
            new_id.insert(NodeId(i as u32), NodeId(tree.nodes.len() as u32));
            tree.nodes.push(node);
        }
        let (count, max) = (tree.materials.len() as u64, MAX_MATERIALS as u64);
        if count > max {
            return Err(too_many("materials", count, max, "share materials between parts"));
        }
        let mut taken = BTreeSet::new();
        for material in &mut tree.materials {
            let said = material.name.clone();
            let mut again = 2;
            while !taken.insert(material.name.clone()) {
                material.name = format!("{said}_{again}");
                again += 1;
            }
        }
        let unwritable = |e: serde_json::Error| Complaint::new(format!("the tree cannot be written: {e}"));
        let mut json = serde_json::to_value(&tree).map_err(unwritable)?;
        round(&mut json);
        serde_json::from_value(json).map_err(unwritable)
    }
}

/// Rounds every number that is no whole one to nine decimals (a nanometre); such numbers are read back exactly.
fn round(json: &mut serde_json::Value) {
    use serde_json::Value as Json;
    match json {
        Json::Number(n) if n.is_f64() => {
            if let Some(rounded) = n.as_f64().map(|x| libm::rint(x * 1e9) / 1e9 + 0.0) {
                *json = Json::from(rounded);
            }
        }
        Json::Array(list) => list.iter_mut().for_each(round),
        Json::Object(map) => map.values_mut().for_each(round),
        _ => {}
    }
}

fn describe(kind: &Kind, name: Option<&str>, line: u32) -> String {
    let word = serde_json::to_value(kind).ok().and_then(|v| v["kind"].as_str().map(str::to_owned));
    let word = word.unwrap_or_else(|| "part".to_owned());
    let name = name.map(|n| format!(" `{n}`")).unwrap_or_default();
    format!("{word}{name} of line {line}")
}

/// Rewrites what a node refers to.
fn map_nodes(kind: &mut Kind, to: &dyn Fn(NodeId) -> NodeId) {
    use harmony_shape::tree::Along;
    let one = |id: &mut NodeId| *id = to(*id);
    match kind {
        Kind::Group { children } | Kind::Blend { children, .. } | Kind::Stack { children, .. } => {
            children.iter_mut().for_each(one);
        }
        Kind::Placed { child, .. }
        | Kind::Copies { child, .. }
        | Kind::Shell { child, .. }
        | Kind::Tuft { child, .. }
        | Kind::Quilt { child, .. }
        | Kind::Slump { child, .. }
        | Kind::Fuzz { child, .. }
        | Kind::Wicker { child, .. }
        | Kind::Joint { child, .. }
        | Kind::Paint { child, .. }
        | Kind::Decal { child, .. } => one(child),
        Kind::On { child, other, .. } | Kind::Against { child, other, .. } => {
            one(child);
            one(other);
        }
        Kind::Scatter { children, on, .. } => {
            children.iter_mut().for_each(one);
            one(on);
        }
        Kind::Boolean { a, b, .. } => {
            one(a);
            one(b);
        }
        Kind::Drape { over, .. } => over.iter_mut().for_each(one),
        Kind::Fringe { along: Along::Hem { of, .. }, .. } => one(of),
        Kind::Plant { leaf: Some(leaf), .. } => one(leaf),
        _ => {}
    }
}

fn outline_points(outline: &Outline) -> usize {
    outline.points.len()
        + outline.holes.iter().map(Vec::len).sum::<usize>()
        + outline.islands.iter().map(outline_points).sum::<usize>()
}

/// Points that a node stores itself.
fn points_of(kind: &Kind) -> usize {
    use harmony_shape::tree::Along;
    match kind {
        Kind::Lathe { profile, .. } | Kind::BentSheet { profile, .. } => profile.len(),
        Kind::Extrude { outline, .. } | Kind::WireNet { outline, .. } => outline_points(outline),
        Kind::Sweep { curve, section, .. } => {
            let section = match section {
                Section::Round(_) => 0,
                Section::Outline(outline) => outline_points(outline),
            };
            curve.points.len() + section
        }
        Kind::Braid { curve, .. } | Kind::Fringe { along: Along::Curve(curve), .. } => curve.points.len(),
        Kind::Loft { sections, .. } => sections.iter().map(|s| outline_points(&s.outline)).sum(),
        Kind::Surf { points, .. } => points.len(),
        Kind::Mesh { points, faces } => points.len() + faces.iter().map(Vec::len).sum::<usize>(),
        Kind::Copies { places, .. } => places.len(),
        _ => 0,
    }
}

/// Particles of a draped cloth: cells of 16 mm, or 8000 of them.
fn cloth_particles(size: [f64; 2]) -> u64 {
    let area = size[0] * size[1];
    let cell = 0.016_f64.max((area / 8000.0).sqrt());
    ((area / (cell * cell)).ceil() as u64).max(16)
}

/// About how many triangles a node adds of its own: a bound for what is refused, not a promise.
fn own_triangles(kind: &Kind) -> u64 {
    use harmony_shape::tree::{Along, FringeKind};
    let curve_length = |points: &[[f64; 3]]| -> f64 {
        points.windows(2).map(|w| (glam::DVec3::from(w[1]) - glam::DVec3::from(w[0])).length()).sum()
    };
    match kind {
        Kind::Box { bevel, segments, .. } if *bevel > 0.0 => {
            12 + 24 * u64::from(*segments) * (1 + u64::from(*segments))
        }
        Kind::Box { .. } => 12,
        Kind::Cylinder { sides, .. } => 8 * u64::from(if *sides == 0 { 32 } else { *sides }),
        Kind::Sphere { .. } => 900,
        Kind::Lathe { profile, .. } => 96 * profile.len() as u64,
        Kind::Extrude { outline, .. } => 8 * outline_points(outline) as u64,
        Kind::Sweep { curve, section, rings, .. } => {
            let around = match section {
                Section::Round(_) => 12,
                Section::Outline(outline) => outline_points(outline) as u64,
            };
            let ringed = if rings[0] > 0.0 { (6.0 * curve_length(&curve.points) / rings[0]) as u64 } else { 0 };
            2 * around * (curve.points.len() as u64).max(ringed)
        }
        Kind::Braid { curve, strands, .. } => 16 * u64::from(*strands) * curve.points.len() as u64,
        Kind::Loft { sections, .. } => sections.iter().map(|s| 2 * outline_points(&s.outline) as u64).sum(),
        Kind::BentSheet { profile, .. } => 8 * profile.len() as u64,
        Kind::Surf { points, thick, .. } => (if *thick > 0.0 { 4 } else { 2 }) * points.len() as u64,
        Kind::Mesh { faces, .. } => faces.iter().map(|f| f.len() as u64).sum(),
        Kind::Blend { .. } => 20_000,
        Kind::Pillow { .. } => 3000,
        Kind::Cushion { .. } => 2500,
        Kind::Tuft { .. } | Kind::Quilt { .. } => 15_000,
        Kind::Drape { size, .. } => 4 * cloth_particles(*size),
        Kind::Hang { folds, .. } => 400 * u64::from(*folds),
        Kind::Roll { turns, .. } => (200.0 * turns) as u64,
        Kind::Folded { layers, .. } => 200 * u64::from(*layers),
        Kind::Fringe { along, fringe, spacing, .. } => {
            let length = match along {
                Along::Curve(curve) => curve_length(&curve.points),
                Along::Hem { .. } => 4.0,
            };
            let each = match fringe {
                FringeKind::Thread | FringeKind::Lace => 16,
                FringeKind::Tassel => 400,
                FringeKind::Pompom => 600,
            };
            each * (length / spacing) as u64
        }
        Kind::Fuzz { .. } => 40_000,
        Kind::Wicker { .. } => 40_000,
        Kind::WireNet { outline, pitch, .. } => bounds::of_outline(outline)
            .map_or(0, |[min, max]| (16.0 * ((max[0] - min[0]) + (max[1] - min[1])) / pitch) as u64),
        Kind::Leaf { .. } => 24,
        Kind::Plant { count, .. } => 60 * u64::from(*count),
        Kind::Template { .. } | Kind::PartModel { .. } => 5000,
        _ => 0,
    }
}
