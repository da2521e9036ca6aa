//! Cloth as a result: a piece and its edges.

use glam::DVec3;

use crate::Piece;

/// The edges of a cloth, polylines in the cloth's coordinates.
///
/// `head` is the edge at -z of a draped cloth before its turn, or the top of a hanging one; `foot` the opposite one;
/// `left` at -x, `right` at +x. Head and foot run from left to right, left and right from head to foot.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Hems {
    /// Edge at the head, left to right.
    pub head: Vec<DVec3>,
    /// Edge at the foot, left to right.
    pub foot: Vec<DVec3>,
    /// Left edge, head to foot.
    pub left: Vec<DVec3>,
    /// Right edge, head to foot.
    pub right: Vec<DVec3>,
}

impl Hems {
    /// An edge by name: `head`, `foot`, `left`, `right`, or `all` (closed: the last point is next to the first one).
    pub fn named(&self, side: &str) -> Option<Vec<DVec3>> {
        match side {
            "head" => Some(self.head.clone()),
            "foot" => Some(self.foot.clone()),
            "left" => Some(self.left.clone()),
            "right" => Some(self.right.clone()),
            "all" => {
                let mut all = self.head.clone();
                all.extend(self.right.iter().skip(1));
                all.extend(self.foot.iter().rev().skip(1));
                all.extend(self.left.iter().rev().skip(1));
                all.pop();
                Some(all)
            }
            _ => None,
        }
    }
}

/// A cloth in its place.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Cloth {
    /// The cloth, with its thickness; texture coordinates are those of the flat cloth in metres.
    pub piece: Piece,
    /// Its edges.
    pub hems: Hems,
    /// Rod, rings or hooks that hold it (metal, another material than the cloth's); empty for a draped cloth.
    pub fittings: Piece,
}
