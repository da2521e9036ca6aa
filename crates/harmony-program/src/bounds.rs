//! How large a part is, as far as a program can know before anything is meshed.

use glam::{DMat3, DVec3};
use harmony_shape::tree::{Along, Axis, Kind, NodeId, Outline, Section};

/// An axis-parallel box in a part's own frame, metres. For simple kinds it is exact, for others the part lies within.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds {
    /// Least coordinates.
    pub min: DVec3,
    /// Greatest coordinates.
    pub max: DVec3,
}

impl Bounds {
    /// A box standing on y = 0, centred in x and z.
    pub fn standing(size: [f64; 3]) -> Self {
        let [w, h, d] = size;
        Self { min: DVec3::new(-w / 2.0, 0.0, -d / 2.0), max: DVec3::new(w / 2.0, h, d / 2.0) }
    }

    /// Around points; none when there are none.
    pub fn around(points: impl IntoIterator<Item = DVec3>) -> Option<Self> {
        points.into_iter().fold(None, |all: Option<Self>, p| {
            Some(all.map_or(Self { min: p, max: p }, |b| Self { min: b.min.min(p), max: b.max.max(p) }))
        })
    }

    /// Both.
    #[must_use]
    pub fn with(self, other: Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    /// Larger by a margin on all sides.
    #[must_use]
    pub fn grown(self, by: f64) -> Self {
        Self { min: self.min - by, max: self.max + by }
    }

    /// Moved.
    #[must_use]
    pub fn moved(self, by: DVec3) -> Self {
        Self { min: self.min + by, max: self.max + by }
    }

    /// Around the box after an affine map.
    #[must_use]
    pub fn mapped(self, columns: &[[f64; 3]; 4]) -> Self {
        let [x, y, z, origin] = columns.map(DVec3::from);
        let linear = DMat3::from_cols(x, y, z);
        let centre = linear * self.centre() + origin;
        let reach = DMat3::from_cols(x.abs(), y.abs(), z.abs()) * (self.size() / 2.0);
        Self { min: centre - reach, max: centre + reach }
    }

    /// Width, height, depth.
    pub fn size(&self) -> DVec3 {
        self.max - self.min
    }

    /// Middle.
    pub fn centre(&self) -> DVec3 {
        (self.min + self.max) / 2.0
    }
}

/// Around an outline: least and greatest x and y.
pub fn of_outline(outline: &Outline) -> Option<[[f64; 2]; 2]> {
    let own = outline.points.iter().copied().map(|p| [p, p]);
    let islands = outline.islands.iter().filter_map(of_outline);
    own.chain(islands)
        .reduce(|a, b| [[a[0][0].min(b[0][0]), a[0][1].min(b[0][1])], [a[1][0].max(b[1][0]), a[1][1].max(b[1][1])]])
}

/// Bounds of a node from those of the nodes before it; none where only meshing can tell.
pub fn of(kind: &Kind, known: &dyn Fn(NodeId) -> Option<Bounds>) -> Option<Bounds> {
    let all = |ids: &[NodeId]| -> Option<Bounds> {
        let each: Option<Vec<Bounds>> = ids.iter().map(|&id| known(id)).collect();
        each?.into_iter().reduce(Bounds::with)
    };
    match kind {
        Kind::Group { children } | Kind::Blend { children, .. } => all(children),
        Kind::Placed { child, columns } => Some(known(*child)?.mapped(columns)),
        Kind::Copies { child, places } => {
            let child = known(*child)?;
            places.iter().map(|columns| child.mapped(columns)).reduce(Bounds::with)
        }
        Kind::On { child, other, u, v } => {
            let (child, other) = (known(*child)?, known(*other)?);
            let size = other.size();
            let spot = DVec3::new(other.min.x + u * size.x, other.max.y - child.min.y, other.min.z + v * size.z);
            Some(child.moved(spot))
        }
        Kind::Stack { children, gap, jitter, .. } => {
            let mut top = 0.0;
            let mut out: Option<Bounds> = None;
            for &id in children {
                let bounds = known(id)?;
                let moved = bounds.moved(DVec3::new(0.0, top - bounds.min.y, 0.0));
                top = moved.max.y + gap;
                out = Some(out.map_or(moved, |b| b.with(moved)));
            }
            out.map(|b| Bounds {
                min: b.min - DVec3::new(0.05, 0.0, 0.05) * *jitter,
                max: b.max + DVec3::new(0.05, 0.0, 0.05) * *jitter,
            })
        }
        Kind::Box { size, taper, shear, .. } => {
            let [w, h, d] = *size;
            let bottom = Bounds::standing([w, 0.0, d]);
            let top = Bounds::standing([w * taper[0], 0.0, d * taper[1]]).moved(DVec3::new(shear[0], h, shear[1]));
            Some(bottom.with(top))
        }
        Kind::Cylinder { radius, height, top_radius, .. } => {
            let r = 2.0 * radius.max(*top_radius);
            Some(Bounds::standing([r, *height, r]))
        }
        Kind::Sphere { radii } => Some(Bounds::standing(radii.map(|r| 2.0 * r))),
        Kind::Lathe { profile, oval, lobe_depth, lobes, .. } => {
            let widest = profile.iter().map(|p| p[0].abs()).fold(0.0, f64::max);
            let r = if *lobes > 0 { widest * (1.0 + lobe_depth.abs()) } else { widest };
            let points = profile.iter().flat_map(|p| [DVec3::new(-r, p[1], -r * oval), DVec3::new(r, p[1], r * oval)]);
            Bounds::around(points)
        }
        Kind::Extrude { outline, depth, axis, bend_deg, twist_deg, .. } => {
            let [min, max] = of_outline(outline)?;
            let half = depth / 2.0;
            let b = match axis {
                Axis::Z => Bounds { min: DVec3::new(min[0], min[1], -half), max: DVec3::new(max[0], max[1], half) },
                Axis::X => Bounds { min: DVec3::new(-half, min[1], -max[0]), max: DVec3::new(half, max[1], -min[0]) },
                Axis::Y => Bounds { min: DVec3::new(min[0], 0.0, -max[1]), max: DVec3::new(max[0], *depth, -min[1]) },
            };
            let turned = *bend_deg != 0.0 || *twist_deg != 0.0;
            Some(if turned { b.grown(b.size().max_element() / 2.0) } else { b })
        }
        Kind::Sweep { curve, section, taper, rings, .. } => {
            let reach = match section {
                Section::Round(radius) => *radius,
                Section::Outline(outline) => {
                    let [min, max] = of_outline(outline)?;
                    DVec3::new(min[0].abs().max(max[0].abs()), min[1].abs().max(max[1].abs()), 0.0).length()
                }
            };
            let b = Bounds::around(curve.points.iter().copied().map(DVec3::from))?;
            Some(b.grown(reach * taper.max(1.0) + rings[1]))
        }
        Kind::Braid { curve, radius, .. } => {
            Some(Bounds::around(curve.points.iter().copied().map(DVec3::from))?.grown(*radius))
        }
        Kind::Loft { sections, .. } => sections
            .iter()
            .map(|s| {
                let [min, max] = of_outline(&s.outline)?;
                let reach = DVec3::new(min[0].abs().max(max[0].abs()), min[1].abs().max(max[1].abs()), 0.0).length();
                let level = s.turn_deg == [0.0; 3];
                let b = if level {
                    Bounds { min: DVec3::new(min[0], 0.0, -max[1]), max: DVec3::new(max[0], 0.0, -min[1]) }
                } else {
                    Bounds { min: DVec3::splat(-reach), max: DVec3::splat(reach) }
                };
                Some(b.moved(s.at.into()))
            })
            .collect::<Option<Vec<_>>>()?
            .into_iter()
            .reduce(Bounds::with),
        Kind::BentSheet { profile, width, thick, axis, .. } => {
            let half = width / 2.0;
            let points = profile.iter().flat_map(|p| {
                let [a, b] = *p;
                [-half, half].map(|w| match axis {
                    Axis::X => DVec3::new(w, b, a),
                    Axis::Z => DVec3::new(a, b, w),
                    Axis::Y => DVec3::new(a, w + half, b),
                })
            });
            Some(Bounds::around(points)?.grown(*thick))
        }
        Kind::Surf { points, thick, .. } => {
            Some(Bounds::around(points.iter().copied().map(DVec3::from))?.grown(*thick))
        }
        Kind::Mesh { points, .. } => Bounds::around(points.iter().copied().map(DVec3::from)),
        Kind::Boolean { op, a, b } => match op {
            harmony_shape::tree::Boolean::Join => all(&[*a, *b]),
            _ => known(*a),
        },
        Kind::Shell { child, .. }
        | Kind::Tuft { child, .. }
        | Kind::Quilt { child, .. }
        | Kind::Joint { child, .. } => known(*child),
        Kind::Paint { child, .. } | Kind::Decal { child, .. } => known(*child),
        Kind::Wicker { child, radius, .. } => Some(known(*child)?.grown(*radius)),
        Kind::Fuzz { child, length, .. } => Some(known(*child)?.grown(*length)),
        Kind::Slump { child, amount } => {
            let b = known(*child)?;
            let side = b.size() * DVec3::new(0.5, 0.0, 0.5) * (0.3 * amount);
            Some(Bounds { min: b.min - side, max: b.max + side })
        }
        Kind::Pillow { size: [w, d, t], .. } => Some(Bounds::standing([*w, *t, *d])),
        Kind::Cushion { size, .. } => Some(Bounds::standing(*size)),
        Kind::Hang { size, folds, gather, .. } => {
            // Depth of the folds from the extra cloth: a zigzag of n folds with the given gather.
            let each = size[0] / f64::from(*folds).max(1.0);
            let depth = 0.5 * each * (gather * gather - 1.0).max(0.0).sqrt();
            Some(Bounds::standing([size[0], size[1], depth.max(0.02)]))
        }
        Kind::Roll { width, radius, .. } => Some(Bounds::standing([*width, 2.0 * radius, 2.0 * radius])),
        Kind::Folded { size, layers, thick, .. } => {
            Some(Bounds::standing([size[0], f64::from(*layers) * thick, size[1]]))
        }
        Kind::WireNet { outline, radius, .. } => {
            let [min, max] = of_outline(outline)?;
            Some(Bounds { min: DVec3::new(min[0], min[1], 0.0), max: DVec3::new(max[0], max[1], 0.0) }.grown(*radius))
        }
        Kind::Leaf { size: [l, w], .. } => {
            Some(Bounds { min: DVec3::new(-w / 2.0, -l, 0.0), max: DVec3::new(w / 2.0, l / 2.0, *l) })
        }
        Kind::Plant { height, spread, .. } => Some(Bounds::standing([*spread, *height, *spread])),
        Kind::Light { radius, at, .. } => Some(Bounds { min: (*at).into(), max: (*at).into() }.grown(*radius)),
        Kind::Surface { size, at } => Some(Bounds::standing([size[0], 0.0, size[1]]).moved((*at).into())),
        Kind::Template { size, .. } | Kind::PartModel { size, .. } => Some(Bounds::standing(*size)),
        Kind::Fringe { along: Along::Curve(curve), length, .. } => {
            let b = Bounds::around(curve.points.iter().copied().map(DVec3::from))?.grown(0.02);
            Some(Bounds { min: b.min - DVec3::Y * *length, max: b.max })
        }
        Kind::Fringe { .. } | Kind::Drape { .. } | Kind::Scatter { .. } | Kind::Against { .. } => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_turned_box_has_the_bounds_of_its_corners() {
        let b = Bounds::standing([2.0, 1.0, 4.0]);
        // A quarter turn about +Y: x -> -z, z -> x.
        let columns = [[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [10.0, 0.0, 0.0]];
        let turned = b.mapped(&columns);
        assert_eq!(turned.min, DVec3::new(8.0, 0.0, -1.0));
        assert_eq!(turned.max, DVec3::new(12.0, 1.0, 1.0));
    }
}
