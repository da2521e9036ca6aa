//! Connected parts of a mesh.

use std::collections::BTreeMap;

use crate::Mesh;

/// Number of the connected part of each vertex, by the groups that are taken; vertices at one place are one.
pub fn connected(mesh: &Mesh, takes: &dyn Fn(usize) -> bool) -> Vec<u32> {
    let mut place: BTreeMap<[u32; 3], u32> = BTreeMap::new();
    let mut parent: Vec<u32> = mesh
        .positions
        .iter()
        .enumerate()
        .map(|(i, p)| *place.entry((*p + 0.0).to_array().map(f32::to_bits)).or_insert(i as u32))
        .collect();
    for t in mesh.groups.iter().enumerate().filter(|(g, _)| takes(*g)).flat_map(|(_, g)| &g.triangles) {
        for k in 1..3 {
            let (a, b) = (root(&mut parent, t[0]), root(&mut parent, t[k]));
            parent[a.max(b) as usize] = a.min(b);
        }
    }
    (0..parent.len() as u32).map(|i| root(&mut parent, i)).collect()
}

/// The representative of a set (union and find).
fn root(parent: &mut [u32], mut i: u32) -> u32 {
    while parent[i as usize] != i {
        parent[i as usize] = parent[parent[i as usize] as usize];
        i = parent[i as usize];
    }
    i
}
