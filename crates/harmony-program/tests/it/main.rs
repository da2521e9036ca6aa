//! Programs from source to tree, in this process and in the cage.

mod bombs;
mod errors;
mod functions;
mod programs;
mod proofs;

use harmony_program::{ChildCommand, Inputs, Limits, ProgramError, evaluate};
use harmony_scene::{Camera, Extents, ImageSize, Intrinsics, Size, Vec3};
use harmony_shape::{Kind, Node, ShapeTree};

/// The child that stands beside these tests.
fn child() -> ChildCommand {
    ChildCommand { program: env!("CARGO_BIN_EXE_harmony-program-child").into(), args: Vec::new() }
}

const ROOM: Extents = Extents { width: 4.0, height: 2.6, depth: 4.5 };

fn camera() -> Camera {
    let size = ImageSize::new(1200, 900);
    let lens = Intrinsics::from_horizontal_fov(size, 1.5);
    Camera::looking(size, lens, Vec3::new(2.0, 1.4, 4.2), Vec3::new(0.0, 0.0, -1.0))
}

fn object() -> Inputs {
    Inputs::object(Size { width: 1.0, height: 0.8, depth: 0.6 })
}

/// A program whose `build` returns an expression.
fn returning(expression: &str) -> String {
    format!("def build(w, h, d):\n    return {expression}\n")
}

fn tree(source: &str) -> ShapeTree {
    evaluate(source, &object(), &Limits::default()).unwrap_or_else(|e| panic!("{}", e.explain(source)))
}

fn fails(source: &str) -> ProgramError {
    evaluate(source, &object(), &Limits::default()).expect_err(source)
}

fn root(tree: &ShapeTree) -> &Node {
    tree.nodes.last().expect("a root")
}

fn named<'a>(tree: &'a ShapeTree, name: &str) -> &'a Node {
    tree.nodes.iter().find(|n| n.name.as_deref() == Some(name)).unwrap_or_else(|| panic!("no {name}"))
}

/// The one child of a group, copy or placement, however deep, that is none of these.
fn leaf<'a>(tree: &'a ShapeTree, node: &'a Node) -> &'a Node {
    match &node.kind {
        Kind::Placed { child, .. } | Kind::Copies { child, .. } => leaf(tree, &tree.nodes[child.0 as usize]),
        Kind::Group { children } if children.len() == 1 => leaf(tree, &tree.nodes[children[0].0 as usize]),
        _ => node,
    }
}

/// That a tree is one: children before parents, materials there.
fn sound(tree: &ShapeTree) {
    for (i, node) in tree.nodes.iter().enumerate() {
        assert!(node.kind.references().iter().all(|r| (r.0 as usize) < i), "node {i}");
        assert!(node.material.is_none_or(|m| (m as usize) < tree.materials.len()), "node {i}");
    }
}
