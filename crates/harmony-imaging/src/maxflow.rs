//! Minimum cut on an 8-connected pixel grid, of which only some pixels are nodes.
//!
//! Y. Boykov, V. Kolmogorov, "An Experimental Comparison of Min-Cut/Max-Flow Algorithms for Energy Minimization in
//! Vision", IEEE PAMI 26(9), 2004: two search trees grow from source and sink until they meet, the path is saturated,
//! and cut-off nodes look for a new parent. Written from the paper's description, with its distance and time-stamp
//! heuristics. Capacities are integers, so that the search ends exactly.

use std::collections::VecDeque;

/// Steps to the eight neighbours; `d ^ 1` is the way back.
pub(crate) const STEPS: [(i32, i32); 8] = [(1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, -1), (1, -1), (-1, 1)];

/// "No such node".
const NOWHERE: u32 = u32::MAX;
/// Parent codes above the eight directions.
const TERMINAL: u8 = 8;
const ORPHAN: u8 = 9;
const FREE: u8 = 10;

/// The graph, and after [`GridGraph::solve`] its residual.
pub(crate) struct GridGraph {
    /// Node of each pixel, or [`NOWHERE`].
    node_of: Vec<u32>,
    /// Pixel of each node.
    pixel_of: Vec<u32>,
    neighbours: Vec<[u32; 8]>,
    capacity: Vec<[i32; 8]>,
    /// Residual to the terminals: positive from the source, negative to the sink.
    terminal: Vec<i32>,
    parent: Vec<u8>,
    in_sink_tree: Vec<bool>,
    stamp: Vec<u32>,
    distance: Vec<u32>,
    active: VecDeque<u32>,
    is_active: Vec<bool>,
    orphans: VecDeque<u32>,
    time: u32,
}

impl GridGraph {
    /// A graph without capacities whose nodes are the pixels with `is_node`.
    pub(crate) fn new(width: usize, height: usize, is_node: &[bool]) -> Self {
        let mut node_of = vec![NOWHERE; width * height];
        let mut pixel_of = Vec::new();
        for (pixel, on) in is_node.iter().enumerate() {
            if *on {
                node_of[pixel] = pixel_of.len() as u32;
                pixel_of.push(pixel as u32);
            }
        }
        let neighbours = pixel_of
            .iter()
            .map(|pixel| {
                let (x, y) = (*pixel as i32 % width as i32, *pixel as i32 / width as i32);
                STEPS.map(|(dx, dy)| {
                    let (nx, ny) = (x + dx, y + dy);
                    if nx < 0 || ny < 0 || nx >= width as i32 || ny >= height as i32 {
                        NOWHERE
                    } else {
                        node_of[ny as usize * width + nx as usize]
                    }
                })
            })
            .collect();
        let n = pixel_of.len();
        Self {
            node_of,
            pixel_of,
            neighbours,
            capacity: vec![[0; 8]; n],
            terminal: vec![0; n],
            parent: vec![FREE; n],
            in_sink_tree: vec![false; n],
            stamp: vec![0; n],
            distance: vec![0; n],
            active: VecDeque::new(),
            is_active: vec![false; n],
            orphans: VecDeque::new(),
            time: 0,
        }
    }

    /// Pixel of every node.
    pub(crate) fn pixels(&self) -> &[u32] {
        &self.pixel_of
    }

    /// Adds to a node's pull: positive towards the source (foreground), negative towards the sink.
    pub(crate) fn pull(&mut self, node: usize, amount: i32) {
        self.terminal[node] = self.terminal[node].saturating_add(amount);
    }

    /// Sets the capacity both ways between a node and its neighbour in a direction; without effect when that
    /// neighbour is no node.
    pub(crate) fn connect(&mut self, node: usize, direction: usize, amount: i32) {
        let other = self.neighbours[node][direction];
        if other != NOWHERE {
            self.capacity[node][direction] = amount;
            self.capacity[other as usize][direction ^ 1] = amount;
        }
    }

    /// Whether the pixel is a node.
    pub(crate) fn is_node(&self, pixel: usize) -> bool {
        self.node_of[pixel] != NOWHERE
    }

    /// Finds the minimum cut; true for each node on the source side.
    pub(crate) fn solve(mut self) -> Vec<bool> {
        for node in 0..self.terminal.len() {
            if self.terminal[node] != 0 {
                self.in_sink_tree[node] = self.terminal[node] < 0;
                self.parent[node] = TERMINAL;
                self.distance[node] = 1;
                self.activate(node as u32);
            }
        }
        let mut current: Option<u32> = None;
        loop {
            let node = match current.take() {
                Some(node) if self.parent[node as usize] != FREE => node,
                _ => match self.next_active() {
                    Some(node) => node,
                    None => break,
                },
            };
            self.time += 1;
            if let Some((from, direction)) = self.grow(node as usize) {
                self.augment(from, direction);
                while let Some(orphan) = self.orphans.pop_front() {
                    self.adopt(orphan as usize);
                }
                current = Some(node);
            }
        }
        self.parent.iter().zip(&self.in_sink_tree).map(|(parent, sink)| *parent != FREE && !sink).collect()
    }

    fn activate(&mut self, node: u32) {
        if !self.is_active[node as usize] {
            self.is_active[node as usize] = true;
            self.active.push_back(node);
        }
    }

    fn next_active(&mut self) -> Option<u32> {
        while let Some(node) = self.active.pop_front() {
            self.is_active[node as usize] = false;
            if self.parent[node as usize] != FREE {
                return Some(node);
            }
        }
        None
    }

    /// Grows the tree of an active node; the edge (source-side node, direction) where it meets the other tree.
    fn grow(&mut self, node: usize) -> Option<(usize, usize)> {
        let sink = self.in_sink_tree[node];
        for d in 0..8 {
            let other = self.neighbours[node][d];
            if other == NOWHERE {
                continue;
            }
            let j = other as usize;
            let residual = if sink { self.capacity[j][d ^ 1] } else { self.capacity[node][d] };
            if residual <= 0 {
                continue;
            }
            if self.parent[j] == FREE {
                self.in_sink_tree[j] = sink;
                self.parent[j] = (d ^ 1) as u8;
                self.stamp[j] = self.stamp[node];
                self.distance[j] = self.distance[node] + 1;
                self.activate(other);
            } else if self.in_sink_tree[j] != sink {
                return Some(if sink { (j, d ^ 1) } else { (node, d) });
            } else if self.stamp[j] <= self.stamp[node] && self.distance[j] > self.distance[node] {
                // A shorter way to the terminal.
                self.parent[j] = (d ^ 1) as u8;
                self.stamp[j] = self.stamp[node];
                self.distance[j] = self.distance[node] + 1;
            }
        }
        None
    }

    /// Pushes as much as fits through the path over the edge.
    fn augment(&mut self, from: usize, direction: usize) {
        let to = self.neighbours[from][direction] as usize;
        let mut amount = self.capacity[from][direction];
        for (start, sink) in [(from, false), (to, true)] {
            let mut x = start;
            while self.parent[x] != TERMINAL {
                let p = self.parent[x] as usize;
                let q = self.neighbours[x][p] as usize;
                amount = amount.min(if sink { self.capacity[x][p] } else { self.capacity[q][p ^ 1] });
                x = q;
            }
            amount = amount.min(self.terminal[x].abs());
        }
        self.capacity[from][direction] -= amount;
        self.capacity[to][direction ^ 1] += amount;
        for (start, sink) in [(from, false), (to, true)] {
            let mut x = start;
            while self.parent[x] != TERMINAL {
                let p = self.parent[x] as usize;
                let q = self.neighbours[x][p] as usize;
                let (a, da, b, db) = if sink { (x, p, q, p ^ 1) } else { (q, p ^ 1, x, p) };
                self.capacity[a][da] -= amount;
                self.capacity[b][db] += amount;
                if self.capacity[a][da] == 0 {
                    self.parent[x] = ORPHAN;
                    self.orphans.push_front(x as u32);
                }
                x = q;
            }
            self.terminal[x] += if sink { amount } else { -amount };
            if self.terminal[x] == 0 {
                self.parent[x] = ORPHAN;
                self.orphans.push_front(x as u32);
            }
        }
    }

    /// Steps from a node to its terminal, or `None` when it hangs on an orphan.
    fn origin(&mut self, node: usize) -> Option<u32> {
        let mut x = node;
        let mut steps = 0;
        let total = loop {
            if self.stamp[x] == self.time {
                break steps + self.distance[x];
            }
            match self.parent[x] {
                TERMINAL => {
                    self.stamp[x] = self.time;
                    self.distance[x] = 1;
                    break steps + 1;
                }
                ORPHAN | FREE => return None,
                p => {
                    steps += 1;
                    x = self.neighbours[x][p as usize] as usize;
                }
            }
        };
        // Remember the distances, so that the next look-up is short.
        let mut x = node;
        let mut left = total;
        while self.stamp[x] != self.time {
            self.stamp[x] = self.time;
            self.distance[x] = left;
            left -= 1;
            x = self.neighbours[x][self.parent[x] as usize] as usize;
        }
        Some(total)
    }

    /// Finds a new parent for an orphan, or frees it and orphans its children.
    fn adopt(&mut self, node: usize) {
        let sink = self.in_sink_tree[node];
        let mut best: Option<(u32, usize)> = None;
        for d in 0..8 {
            let other = self.neighbours[node][d];
            if other == NOWHERE {
                continue;
            }
            let j = other as usize;
            let residual = if sink { self.capacity[node][d] } else { self.capacity[j][d ^ 1] };
            if residual <= 0 || self.in_sink_tree[j] != sink || self.parent[j] == FREE {
                continue;
            }
            if let Some(steps) = self.origin(j)
                && best.is_none_or(|(s, _)| steps < s)
            {
                best = Some((steps, d));
            }
        }
        if let Some((steps, d)) = best {
            self.parent[node] = d as u8;
            self.stamp[node] = self.time;
            self.distance[node] = steps + 1;
            return;
        }
        self.parent[node] = FREE;
        for d in 0..8 {
            let other = self.neighbours[node][d];
            if other == NOWHERE {
                continue;
            }
            let j = other as usize;
            if self.in_sink_tree[j] != sink || self.parent[j] == FREE {
                continue;
            }
            let residual = if sink { self.capacity[node][d] } else { self.capacity[j][d ^ 1] };
            if residual > 0 {
                self.activate(other);
            }
            if self.parent[j] as usize == d ^ 1 {
                self.parent[j] = ORPHAN;
                self.orphans.push_back(other);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Energy of a labelling: pulls against the label plus cut edges.
    fn energy(pull: &[i32], edges: &[(usize, usize, i32)], label: &[bool]) -> i32 {
        let unary: i32 = pull.iter().zip(label).map(|(p, l)| if *l { (-p).max(0) } else { (*p).max(0) }).sum();
        unary + edges.iter().filter(|(a, b, _)| label[*a] != label[*b]).map(|e| e.2).sum::<i32>()
    }

    #[test]
    fn the_cut_is_the_best_of_all_labellings_of_small_grids() {
        let (w, h) = (4, 3);
        let mut state = 7_u64;
        let mut random = |n: i32| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            ((state >> 33) as i32).rem_euclid(n)
        };
        for _ in 0..60 {
            let pull: Vec<i32> = (0..w * h).map(|_| random(41) - 20).collect();
            let mut graph = GridGraph::new(w, h, &vec![true; w * h]);
            let mut edges = Vec::new();
            for (node, amount) in pull.iter().enumerate() {
                graph.pull(node, *amount);
                for d in [0, 2, 4, 6] {
                    let (x, y) = ((node % w) as i32 + STEPS[d].0, (node / w) as i32 + STEPS[d].1);
                    if x >= 0 && y >= 0 && x < w as i32 && y < h as i32 {
                        let amount = random(12);
                        graph.connect(node, d, amount);
                        edges.push((node, y as usize * w + x as usize, amount));
                    }
                }
            }
            let cut = energy(&pull, &edges, &graph.solve());
            let best = (0..1_u32 << (w * h))
                .map(|bits| {
                    let label: Vec<bool> = (0..w * h).map(|i| bits >> i & 1 == 1).collect();
                    energy(&pull, &edges, &label)
                })
                .min()
                .unwrap();
            assert_eq!(cut, best);
        }
    }
}
