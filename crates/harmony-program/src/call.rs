//! One call of a modelling function: which arguments were given, what they are, and what is wrong with them.

use std::ops::RangeInclusive;
use std::sync::{Arc, LazyLock};

use glam::DVec3;
use harmony_shape::MaterialSpec;
use harmony_shape::tree::{Curve, Face, MAX_COORDINATE, Node, NodeId, Outline};
use starlark::eval::{Arguments, Evaluator, ParametersSpec};
use starlark::values::{FrozenValue, Heap, Value};

use crate::error::{Complaint, Failure};
use crate::functions::{FUNCTIONS, materials, methods};
use crate::names::nearest;
use crate::numbers::{items, number, numbers, vector};
use crate::session::Session;
use crate::thing::{Kind, Thing, word};

/// What a native function gives back.
pub(crate) type Outcome<'v> = Result<Value<'v>, Failure>;

/// A native function.
pub(crate) struct Function {
    /// As it is called.
    pub name: String,
    /// As it is shown: `box(size, bevel=0, ...)`.
    pub signature: &'static str,
    /// Parameters in order; whether each may be left out.
    params: Vec<(String, bool)>,
    rest: Rest,
    run: for<'v, 's> fn(&mut Call<'v, 's>) -> Outcome<'v>,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Rest {
    None,
    /// `*items`: further arguments without a name.
    Positional,
    /// `*items, **named`: further arguments of both kinds.
    Both,
}

impl Function {
    /// From its signature. A `...` at the end stands for `mat=None, name=None`.
    pub fn new(signature: &'static str, run: for<'v, 's> fn(&mut Call<'v, 's>) -> Outcome<'v>) -> Self {
        let (name, rest) = signature.split_once('(').unwrap_or((signature, ")"));
        let inner = rest.rsplit_once(')').map_or(rest, |(inner, _)| inner);
        let mut params = Vec::new();
        let mut kind = Rest::None;
        let (mut depth, mut start) = (0, 0);
        let mut add = |text: &str| {
            let text = text.trim();
            if text == "..." {
                params.push(("mat".to_owned(), true));
                params.push(("name".to_owned(), true));
            } else if text.starts_with("**") {
                kind = Rest::Both;
            } else if text.starts_with('*') {
                kind = Rest::Positional;
            } else if !text.is_empty() {
                let (name, default) = text.split_once('=').map_or((text, false), |(name, _)| (name, true));
                params.push((name.trim().to_owned(), default));
            }
        };
        for (i, c) in inner.char_indices() {
            match c {
                '(' | '[' => depth += 1,
                ')' | ']' => depth -= 1,
                ',' if depth == 0 => {
                    add(&inner[start..i]);
                    start = i + 1;
                }
                _ => {}
            }
        }
        add(&inner[start..]);
        Self { name: name.to_owned(), signature, params, rest: kind, run }
    }

    /// Names of its parameters.
    pub fn param_names(&self) -> impl Iterator<Item = &str> {
        self.params.iter().map(|(name, _)| name.as_str())
    }
}

static TABLE: LazyLock<&'static [Function]> = LazyLock::new(|| &FUNCTIONS);

/// A function by its index.
pub(crate) fn function(index: usize) -> &'static Function {
    &TABLE[index]
}

/// A method by its receiver and index.
pub(crate) fn method(receiver: &Kind, index: usize) -> &'static Function {
    &methods(receiver)[index]
}

/// Calls a function: arguments are sorted into parameters, the rest is the function's.
pub(crate) fn invoke<'v>(
    function: &'static Function,
    receiver: Option<Kind>,
    args: &Arguments<'v, '_>,
    eval: &mut Evaluator<'v, '_, '_>,
) -> starlark::Result<Value<'v>> {
    let heap = eval.heap();
    let extra = eval.extra;
    let Some(session) = extra.and_then(|e| e.downcast_ref::<Session>()) else {
        return Err(Failure::Complaint(Complaint::new("no session")).into());
    };
    let line = eval.call_stack_top_location().map_or(0, |l| l.resolve_span().begin.line as u32 + 1);
    let sorted = sort(function, args, heap)?;
    let mut back = |f: Value<'v>, with: &[Value<'v>]| eval.eval_function(f, with, &[]);
    let mut call = Call { function, receiver, session, heap, line, sorted, back: &mut back };
    (function.run)(&mut call).map_err(starlark::Error::from)
}

#[derive(Default)]
struct Sorted<'v> {
    values: Vec<Option<Value<'v>>>,
    positional: Vec<Value<'v>>,
    named: Vec<(String, Value<'v>)>,
}

/// Any arguments at all: `*args, **kwargs`.
static ANY: LazyLock<ParametersSpec<FrozenValue>> =
    LazyLock::new(|| ParametersSpec::new_parts("function", [], [], true, [], true));

fn sort<'v>(function: &'static Function, args: &Arguments<'v, '_>, heap: &'v Heap) -> Result<Sorted<'v>, Failure> {
    let mut sorted = Sorted { values: vec![None; function.params.len()], ..Sorted::default() };
    let say = |message: String| Complaint::new(message).with_hint(function.signature);
    let [positional, _] = ANY.collect_into::<2>(args, heap)?;
    for (i, &value) in positional.and_then(items).unwrap_or_default().iter().enumerate() {
        match sorted.values.get_mut(i) {
            Some(slot) => *slot = Some(value),
            None if function.rest != Rest::None => sorted.positional.push(value),
            None => {
                let most = function.params.len();
                return Err(say(format!("{}() takes at most {most} arguments", function.name)).into());
            }
        }
    }
    for (key, value) in args.names_map()? {
        let key = key.as_str();
        match function.params.iter().position(|(name, _)| name == key) {
            Some(i) if sorted.values[i].is_some() => {
                return Err(say(format!("{}() got `{key}` twice", function.name)).into());
            }
            Some(i) => sorted.values[i] = Some(value),
            None if function.rest == Rest::Both => sorted.named.push((key.to_owned(), value)),
            None => {
                let guess = nearest(key, function.param_names()).map(|n| format!("; did you mean `{n}`?"));
                let guess = guess.unwrap_or_default();
                return Err(say(format!("{}() has no argument `{key}`{guess}", function.name)).into());
            }
        }
    }
    for ((name, optional), value) in function.params.iter().zip(&sorted.values) {
        if !optional && value.is_none() {
            return Err(say(format!("{}() needs `{name}`", function.name)).into());
        }
    }
    Ok(sorted)
}

/// A function of the program, called by one of ours.
type Back<'v, 's> = &'s mut dyn FnMut(Value<'v>, &[Value<'v>]) -> starlark::Result<Value<'v>>;

/// One call.
pub(crate) struct Call<'v, 's> {
    function: &'static Function,
    /// What a method is called on.
    pub receiver: Option<Kind>,
    pub session: &'s Session,
    pub heap: &'v Heap,
    /// Line of the caller.
    pub line: u32,
    sorted: Sorted<'v>,
    back: Back<'v, 's>,
}

/// Length of anything: finite and within the tree's greatest coordinate.
pub(crate) const LENGTH: RangeInclusive<f64> = 1e-6..=MAX_COORDINATE;
/// Length or nothing.
pub(crate) const LENGTH0: RangeInclusive<f64> = 0.0..=MAX_COORDINATE;
/// A coordinate.
pub(crate) const COORDINATE: RangeInclusive<f64> = -MAX_COORDINATE..=MAX_COORDINATE;
/// A share.
pub(crate) const SHARE: RangeInclusive<f64> = 0.0..=1.0;
/// An angle in degrees.
pub(crate) const ANGLE: RangeInclusive<f64> = -100_000.0..=100_000.0;

/// Sides by name.
pub(crate) const FACES: [(&str, Face); 6] = [
    ("front", Face::Front),
    ("back", Face::Back),
    ("left", Face::Left),
    ("right", Face::Right),
    ("top", Face::Top),
    ("bottom", Face::Bottom),
];

impl<'v> Call<'v, '_> {
    /// An argument that was given and is not `None`.
    pub fn given(&self, name: &str) -> Option<Value<'v>> {
        let i = self.function.params.iter().position(|(n, _)| n == name)?;
        self.sorted.values[i].filter(|v| !v.is_none())
    }

    /// An argument that must be given.
    pub fn need(&self, name: &str) -> Result<Value<'v>, Complaint> {
        self.given(name).ok_or_else(|| self.complain(name, "None", "a value"))
    }

    /// Arguments beyond the parameters.
    pub fn rest(&mut self) -> (Vec<Value<'v>>, Vec<(String, Value<'v>)>) {
        (std::mem::take(&mut self.sorted.positional), std::mem::take(&mut self.sorted.named))
    }

    /// "box(): `bevel` is x; y is allowed".
    pub fn complain(&self, name: &str, is: &str, allowed: &str) -> Complaint {
        Complaint::new(format!("{}(): `{name}` is {is}; it must be {allowed}", self.function.name))
            .with_hint(self.function.signature)
    }

    /// The same about a value.
    pub fn refuse(&self, name: &str, value: Value<'v>, allowed: &str) -> Complaint {
        let shown: String = match word(value) {
            kind @ ("int" | "float" | "string" | "bool") => {
                let repr: String = value.to_repr().chars().take(40).collect();
                format!("{repr} ({kind})")
            }
            "list" | "tuple" => {
                let inside: Vec<&str> = items(value).unwrap_or_default().iter().take(4).map(|v| word(*v)).collect();
                format!("a {} of {} ({})", word(value), items(value).map_or(0, <[_]>::len), inside.join(", "))
            }
            kind => format!("a {kind}"),
        };
        self.complain(name, &shown, allowed)
    }

    fn within(&self, name: &str, value: Value<'v>, range: &RangeInclusive<f64>) -> Result<f64, Complaint> {
        match number(value) {
            Some(x) if range.contains(&x) => Ok(x),
            _ => Err(self.refuse(name, value, &format!("a number from {} to {}", range.start(), range.end()))),
        }
    }

    /// A number.
    pub fn number(&self, name: &str, default: f64, range: RangeInclusive<f64>) -> Result<f64, Complaint> {
        self.given(name).map_or(Ok(default), |v| self.within(name, v, &range))
    }

    /// A number that must be given.
    pub fn need_number(&self, name: &str, range: RangeInclusive<f64>) -> Result<f64, Complaint> {
        self.within(name, self.need(name)?, &range)
    }

    /// A whole number (a float without fraction will do).
    pub fn count(&self, name: &str, default: u32, range: RangeInclusive<u32>) -> Result<u32, Complaint> {
        let Some(value) = self.given(name) else { return Ok(default) };
        match number(value) {
            Some(x) if x.fract() == 0.0 && x >= f64::from(*range.start()) && x <= f64::from(*range.end()) => {
                Ok(x as u32)
            }
            _ => Err(self.refuse(name, value, &format!("a whole number from {} to {}", range.start(), range.end()))),
        }
    }

    /// A whole number that must be given.
    pub fn need_count(&self, name: &str, range: RangeInclusive<u32>) -> Result<u32, Complaint> {
        self.need(name)?;
        self.count(name, 0, range)
    }

    /// Yes or no.
    pub fn flag(&self, name: &str, default: bool) -> Result<bool, Complaint> {
        match self.given(name) {
            None => Ok(default),
            Some(value) => match (value.unpack_bool(), number(value)) {
                (Some(flag), _) => Ok(flag),
                (_, Some(x)) => Ok(x != 0.0),
                _ => Err(self.refuse(name, value, "True or False")),
            },
        }
    }

    /// A number or `True` or `False`: `smooth = True`, `bevel = False`.
    pub fn number_or_flag(
        &self,
        name: &str,
        default: f64,
        [no, yes]: [f64; 2],
        range: RangeInclusive<f64>,
    ) -> Result<f64, Complaint> {
        match self.given(name).and_then(Value::unpack_bool) {
            Some(flag) => Ok(if flag { yes } else { no }),
            None => self.number(name, default, range),
        }
    }

    /// Numbers of a fixed length, each within a range.
    pub fn list<const N: usize>(
        &self,
        name: &str,
        default: Option<[f64; N]>,
        range: RangeInclusive<f64>,
    ) -> Result<[f64; N], Complaint> {
        let Some(value) = self.given(name) else {
            return default.ok_or_else(|| self.complain(name, "None", "a tuple"));
        };
        let allowed = || format!("{N} numbers from {} to {}", range.start(), range.end());
        let mut list = numbers(value).ok_or_else(|| self.refuse(name, value, &allowed()))?;
        if let (2, Some(Kind::Vector(_))) = (N, Thing::from_value(value).map(|t| &t.kind)) {
            list.truncate(2);
        }
        <[f64; N]>::try_from(list)
            .ok()
            .filter(|list| list.iter().all(|x| range.contains(x)))
            .ok_or_else(|| self.refuse(name, value, &allowed()))
    }

    /// A point or direction.
    pub fn vector(&self, name: &str, default: Option<DVec3>) -> Result<DVec3, Complaint> {
        let Some(value) = self.given(name) else {
            return default.ok_or_else(|| self.complain(name, "None", "a point (x, y, z)"));
        };
        self.point(name, value)
    }

    /// A value as a point.
    pub fn point(&self, name: &str, value: Value<'v>) -> Result<DVec3, Complaint> {
        vector(value)
            .filter(|v| v.abs().max_element() <= MAX_COORDINATE)
            .ok_or_else(|| self.refuse(name, value, "a point (x, y, z), at most 100 m from the origin"))
    }

    /// Text.
    pub fn text(&self, name: &str) -> Result<Option<&'v str>, Complaint> {
        match self.given(name) {
            None => Ok(None),
            Some(value) => match value.unpack_str() {
                Some(text) => Ok(Some(text)),
                None => Err(self.refuse(name, value, "a text")),
            },
        }
    }

    /// One of some words.
    pub fn choice<T: Copy>(&self, name: &str, choices: &[(&str, T)], default: Option<T>) -> Result<T, Complaint> {
        let words = || choices.iter().map(|c| c.0).collect::<Vec<_>>().join(", ");
        let Some(value) = self.given(name) else {
            return default.ok_or_else(|| self.complain(name, "None", &format!("one of: {}", words())));
        };
        let text = value.unpack_str().ok_or_else(|| self.refuse(name, value, &format!("one of: {}", words())))?;
        let small = text.to_ascii_lowercase();
        choices.iter().find(|c| c.0 == small).map(|c| c.1).ok_or_else(|| {
            let guess = nearest(text, choices.iter().map(|c| c.0)).map(|n| format!(" (did you mean \"{n}\"?)"));
            self.complain(name, &format!("\"{text}\""), &format!("one of: {}{}", words(), guess.unwrap_or_default()))
        })
    }

    /// One of some words, as text.
    pub fn word(&self, name: &str, choices: &[&'static str], default: &'static str) -> Result<&'static str, Complaint> {
        let pairs: Vec<(&str, &'static str)> = choices.iter().map(|c| (*c, *c)).collect();
        self.choice(name, &pairs, Some(default))
    }

    fn kind(value: Value<'v>) -> Option<&'v Kind> {
        Thing::from_value(value).map(|t| &t.kind)
    }

    /// A part; a list of parts is taken as a group of them.
    pub fn part(&self, name: &str) -> Result<NodeId, Complaint> {
        let value = self.need(name)?;
        self.one_part(name, value)
    }

    /// A value as a part.
    pub fn one_part(&self, name: &str, value: Value<'v>) -> Result<NodeId, Complaint> {
        match Self::kind(value) {
            Some(Kind::Part(id, _)) => Ok(*id),
            _ if items(value).is_some() => {
                let children = self.some_parts(name, value)?;
                self.add(harmony_shape::Kind::Group { children }, None)
            }
            _ => Err(self.refuse(name, value, "a part")),
        }
    }

    /// Parts: one, or lists of them in lists.
    pub fn parts(&self, name: &str) -> Result<Vec<NodeId>, Complaint> {
        self.some_parts(name, self.need(name)?)
    }

    /// A value as parts.
    pub fn some_parts(&self, name: &str, value: Value<'v>) -> Result<Vec<NodeId>, Complaint> {
        let mut out = Vec::new();
        // Lists can hold themselves; none of ours is deep.
        self.collect(name, value, 8, &mut out)?;
        if out.is_empty() {
            return Err(self.refuse(name, value, "a part or a list of parts"));
        }
        Ok(out)
    }

    fn collect(&self, name: &str, value: Value<'v>, depth: u32, out: &mut Vec<NodeId>) -> Result<(), Complaint> {
        match (Self::kind(value), items(value)) {
            (Some(Kind::Part(id, _)), _) => out.push(*id),
            (_, Some(list)) if depth > 0 => {
                for &item in list {
                    self.collect(name, item, depth - 1, out)?;
                }
            }
            (None, _) if value.is_none() => {}
            _ => return Err(self.refuse(name, value, "a part or a list of parts")),
        }
        if out.len() > harmony_shape::tree::MAX_NODES {
            return Err(Complaint::limit(format!("more than {} parts in one list", harmony_shape::tree::MAX_NODES)));
        }
        Ok(())
    }

    /// Points: a list of them, or a curve's.
    pub fn points(&self, name: &str) -> Result<Vec<[f64; 3]>, Complaint> {
        let value = self.need(name)?;
        if let Some(Kind::Curve(curve)) = Self::kind(value) {
            return Ok(curve.points.clone());
        }
        let list = items(value).ok_or_else(|| self.refuse(name, value, "a list of points (x, y, z)"))?;
        self.session.charge_points(list.len())?;
        list.iter().map(|v| self.point(name, *v).map(|p| p.to_array())).collect()
    }

    /// Points of a plane.
    pub fn points2(&self, name: &str) -> Result<Vec<[f64; 2]>, Complaint> {
        let value = self.need(name)?;
        let list = items(value).ok_or_else(|| self.refuse(name, value, "a list of points (x, y)"))?;
        self.session.charge_points(list.len())?;
        list.iter()
            .map(|v| match numbers(*v).as_deref() {
                Some(&[x, y]) if x.abs().max(y.abs()) <= MAX_COORDINATE => Ok([x, y]),
                _ => Err(self.refuse(name, *v, "points of two numbers (x, y)")),
            })
            .collect()
    }

    /// A curve; a list of points is taken as a polyline.
    pub fn curve(&self, name: &str) -> Result<Arc<Curve>, Complaint> {
        let value = self.need(name)?;
        match Self::kind(value) {
            Some(Kind::Curve(curve)) => Ok(curve.clone()),
            Some(Kind::Hem(..)) => Err(self
                .refuse(name, value, "a curve")
                .with_hint("a hem is known when the cloth has fallen: only fringe() takes one")),
            _ if items(value).is_some() => {
                let points = self.points(name)?;
                if points.len() < 2 {
                    return Err(self.refuse(name, value, "a curve of two points at least"));
                }
                Ok(Arc::new(Curve { points, closed: false }))
            }
            _ => Err(self.refuse(name, value, "a curve, as line() or spline() makes it")),
        }
    }

    /// An outline; a list of points is taken as a polygon.
    pub fn outline(&self, name: &str) -> Result<Arc<Outline>, Complaint> {
        let value = self.need(name)?;
        self.one_outline(name, value)
    }

    /// A value as an outline.
    pub fn one_outline(&self, name: &str, value: Value<'v>) -> Result<Arc<Outline>, Complaint> {
        match Self::kind(value) {
            Some(Kind::Outline(outline)) => Ok(outline.clone()),
            _ => Err(self.refuse(name, value, "an outline, as rect(), circle() or polygon() makes it")),
        }
    }

    /// A seed; without one the number of this call.
    pub fn seed(&self) -> Result<u32, Complaint> {
        match self.given("seed") {
            None => Ok(self.session.next_seed()),
            Some(value) => match number(value) {
                Some(x) if (0.0..=4e9).contains(&x) => Ok(x as u32),
                Some(x) if (-2e9..0.0).contains(&x) => Ok((x as i64).rem_euclid(1 << 32) as u32),
                _ => Err(self.refuse("seed", value, "a whole number")),
            },
        }
    }

    /// The material of an argument: a `mat`, a colour, a pattern or a piece of the photo.
    pub fn material(&self, name: &str) -> Result<Option<u32>, Complaint> {
        let Some(value) = self.given(name) else { return Ok(None) };
        let spec = |color: String| materials::plain(&format!("{name}_{}", color.trim_start_matches('#')), &color);
        let spec: MaterialSpec = match Self::kind(value) {
            Some(Kind::Material(index)) => return Ok(Some(*index)),
            Some(Kind::Pattern(pattern)) => {
                let color = pattern.colors.first().cloned().unwrap_or_else(|| "#c0b8ac".to_owned());
                MaterialSpec { map: Some((**pattern).clone()), ..spec(color) }
            }
            Some(Kind::Photo(photo)) => MaterialSpec { photo: Some((**photo).clone()), ..spec("#808080".to_owned()) },
            _ => match materials::color(value) {
                Some(color) => spec(color),
                None => return Err(self.refuse(name, value, "a mat(...) or a colour \"#rrggbb\"")),
            },
        };
        self.session.material(spec).map(Some)
    }

    /// Calls a function of the program.
    pub fn call_back(&mut self, f: Value<'v>, with: &[Value<'v>]) -> starlark::Result<Value<'v>> {
        (self.back)(f, with)
    }

    /// Adds a node with a material.
    pub fn add(&self, kind: harmony_shape::Kind, material: Option<u32>) -> Result<NodeId, Complaint> {
        self.session.add(Node { kind, name: None, material, line: self.line })
    }

    /// A value.
    #[expect(clippy::unnecessary_wraps, reason = "what the functions of the language give back")]
    pub fn value(&self, kind: Kind) -> Outcome<'v> {
        Ok(self.heap.alloc(Thing::from(kind)))
    }

    /// A part of the language from a node.
    pub fn part_value(&self, id: NodeId) -> Outcome<'v> {
        self.value(Kind::Part(id, self.session.bounds(id)))
    }

    /// Adds a node with the arguments `mat` and `name`, and gives it back.
    pub fn make(&self, kind: harmony_shape::Kind) -> Outcome<'v> {
        let material = self.material("mat")?;
        let name = self.text("name")?.map(str::to_owned);
        let id = self.session.add(Node { kind, name, material, line: self.line })?;
        self.part_value(id)
    }

    /// The part that a method is called on.
    pub fn own_part(&self) -> NodeId {
        match self.receiver {
            Some(Kind::Part(id, _)) => id,
            _ => NodeId(0),
        }
    }
}
