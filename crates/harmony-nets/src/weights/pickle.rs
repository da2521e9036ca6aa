//! An interpreter for the pickles in checkpoints of PyTorch. It builds plain values; it can't run anything.
//!
//! Opcodes and names are allow-lists. Values live in an arena and refer to one another by index, so that neither
//! nesting nor cycles can exhaust the stack. Source: the opcode table of Python's `pickletools`.

use super::{Fault, Reader};

/// More values than any checkpoint has.
const MAX_NODES: usize = 20_000_000;

/// Index of a list, tuple, dict or object in the arena.
pub(super) type Node = usize;

/// A value.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Value {
    None,
    Bool(bool),
    Int(i64),
    Float(f64),
    Text(std::rc::Rc<str>),
    /// Raw bytes; nothing that we need is in any.
    Bytes,
    Tuple(Node),
    List(Node),
    Dict(Node),
    /// One of [`GLOBALS`].
    Global(&'static str),
    /// A storage: element type, key, number of elements.
    Storage {
        kind: &'static str,
        key: std::rc::Rc<str>,
        count: i64,
    },
    /// `_rebuild_tensor_v2(storage, offset, size, stride, ..)`: the tuple of its arguments.
    Tensor(Node),
    /// Something harmless that holds no tensor.
    Opaque,
}

/// Names that a checkpoint may use. What is called is looked at in [`Machine::call`].
const GLOBALS: &[&str] = &[
    "collections.OrderedDict",
    "torch._utils._rebuild_tensor_v2",
    "torch._utils._rebuild_tensor",
    "torch._utils._rebuild_parameter",
    "torch.DoubleStorage",
    "torch.FloatStorage",
    "torch.HalfStorage",
    "torch.BFloat16Storage",
    "torch.LongStorage",
    "torch.IntStorage",
    "torch.ShortStorage",
    "torch.CharStorage",
    "torch.ByteStorage",
    "torch.BoolStorage",
    "torch.Size",
    "torch.device",
];

/// The arena and what the pickle left on the stack.
#[derive(Debug)]
pub(super) struct Unpickled {
    nodes: Vec<Vec<Value>>,
    pub(super) root: Value,
    /// Bytes read.
    pub(super) end: usize,
}

impl Unpickled {
    /// Elements of a list or tuple; keys and values in turn of a dict; arguments of a tensor.
    pub(super) fn items(&self, node: Node) -> &[Value] {
        &self.nodes[node]
    }
}

#[derive(Default)]
struct Machine {
    nodes: Vec<Vec<Value>>,
    stack: Vec<Value>,
    marks: Vec<usize>,
    memo: std::collections::BTreeMap<u32, Value>,
}

/// Reads one pickle from its beginning at `at` to its STOP.
pub(super) fn read(bytes: &[u8], at: usize) -> Result<Unpickled, Fault> {
    let mut machine = Machine::default();
    let mut reader = Reader::new(bytes, at);
    while machine.step(&mut reader)? {}
    let root = machine.pop()?;
    Ok(Unpickled { nodes: machine.nodes, root, end: reader.at })
}

fn text(bytes: &[u8]) -> Result<std::rc::Rc<str>, Fault> {
    std::str::from_utf8(bytes).map(Into::into).map_err(|_| Fault::malformed("a pickled text that is not UTF-8"))
}

impl Machine {
    fn pop(&mut self) -> Result<Value, Fault> {
        let floor = self.marks.last().copied().unwrap_or(0);
        if self.stack.len() <= floor {
            return Err(Fault::malformed("the pickle takes more values than it made"));
        }
        self.stack.pop().ok_or_else(|| Fault::malformed("an empty pickle"))
    }

    fn popped_to_mark(&mut self) -> Result<Vec<Value>, Fault> {
        let mark = self.marks.pop().ok_or_else(|| Fault::malformed("the pickle has no mark here"))?;
        Ok(self.stack.split_off(mark))
    }

    fn node(&mut self, items: Vec<Value>) -> Result<Node, Fault> {
        if self.nodes.len() >= MAX_NODES {
            return Err(Fault::malformed("the pickle has too many values"));
        }
        self.nodes.push(items);
        Ok(self.nodes.len() - 1)
    }

    fn tuple(&mut self, n: usize) -> Result<(), Fault> {
        let mut items = Vec::with_capacity(n);
        for _ in 0..n {
            items.push(self.pop()?);
        }
        items.reverse();
        let node = self.node(items)?;
        self.stack.push(Value::Tuple(node));
        Ok(())
    }

    /// Adds items to the list or dict on top of the stack; opaque objects swallow them.
    fn extend(&mut self, items: Vec<Value>) -> Result<(), Fault> {
        match self.stack.last() {
            Some(Value::List(node) | Value::Dict(node)) => {
                let node = *node;
                self.nodes[node].extend(items);
                Ok(())
            }
            Some(Value::Opaque) => Ok(()),
            _ => Err(Fault::malformed("the pickle adds to something that is no list or dict")),
        }
    }

    fn global(&mut self, module: &str, name: &str) -> Result<(), Fault> {
        let full = format!("{module}.{name}");
        let known = GLOBALS.iter().find(|g| **g == full);
        let known = known.ok_or_else(|| {
            Fault::Refused(format!("the checkpoint asks for {full:.80}, and weights need nothing of the kind"))
        })?;
        self.stack.push(Value::Global(known));
        Ok(())
    }

    /// "Calls" one of the allowed names: builds the value that the call would stand for.
    fn call(&mut self) -> Result<(), Fault> {
        let (arguments, callable) = (self.pop()?, self.pop()?);
        let (Value::Tuple(arguments), Value::Global(name)) = (&arguments, &callable) else {
            return Err(Fault::Refused("the checkpoint calls something that has no name".into()));
        };
        let value = match *name {
            "collections.OrderedDict" => {
                // Old pickles give the pairs as the argument.
                let mut items = Vec::new();
                if let Some(Value::List(pairs)) = self.nodes[*arguments].first() {
                    for pair in &self.nodes[*pairs] {
                        if let Value::Tuple(pair) | Value::List(pair) = pair {
                            items.extend(self.nodes[*pair].iter().take(2).cloned());
                        }
                    }
                }
                Value::Dict(self.node(items)?)
            }
            "torch._utils._rebuild_tensor_v2" | "torch._utils._rebuild_tensor" => Value::Tensor(*arguments),
            "torch._utils._rebuild_parameter" => {
                self.nodes[*arguments].first().cloned().ok_or_else(|| Fault::malformed("a parameter of nothing"))?
            }
            "torch.Size" | "torch.device" => Value::Opaque,
            _ => return Err(Fault::Refused(format!("the checkpoint calls {name}, which is not for calling"))),
        };
        self.stack.push(value);
        Ok(())
    }

    /// `('storage', type, key, location, count, ..)`.
    fn persistent(&mut self) -> Result<(), Fault> {
        let id = self.pop()?;
        let items = if let Value::Tuple(node) = id { self.nodes[node].as_slice() } else { &[] };
        match items {
            [Value::Text(tag), Value::Global(kind), Value::Text(key), _, Value::Int(count), ..]
                if &**tag == "storage" =>
            {
                let storage = Value::Storage { kind, key: key.clone(), count: *count };
                self.stack.push(storage);
                Ok(())
            }
            _ => Err(Fault::malformed("a persistent id that names no storage")),
        }
    }

    fn put(&mut self, slot: u32) -> Result<(), Fault> {
        let top = self.stack.last().cloned().ok_or_else(|| Fault::malformed("nothing to remember"))?;
        self.memo.insert(slot, top);
        Ok(())
    }

    fn get(&mut self, slot: u32) -> Result<(), Fault> {
        let value = self.memo.get(&slot).cloned();
        self.stack.push(value.ok_or_else(|| Fault::malformed(format!("memo {slot} was never set")))?);
        Ok(())
    }

    /// One opcode; false at STOP.
    fn step(&mut self, r: &mut Reader<'_>) -> Result<bool, Fault> {
        let at = r.at;
        let op = r.u8()?;
        match op {
            b'.' => return Ok(false),
            0x80 => {
                r.u8()?; // PROTO
            }
            0x95 => {
                r.u64()?; // FRAME
            }
            b'(' => self.marks.push(self.stack.len()),
            b'0' => {
                self.pop()?;
            }
            b'1' => {
                self.popped_to_mark()?;
            }
            b'2' => {
                let top = self.stack.last().cloned().ok_or_else(|| Fault::malformed("nothing to repeat"))?;
                self.stack.push(top);
            }
            b'N' => self.stack.push(Value::None),
            0x88 => self.stack.push(Value::Bool(true)),
            0x89 => self.stack.push(Value::Bool(false)),
            b'K' => {
                let v = r.u8()?;
                self.stack.push(Value::Int(v.into()));
            }
            b'M' => {
                let v = r.u16()?;
                self.stack.push(Value::Int(v.into()));
            }
            b'J' => {
                let v = r.u32()?.cast_signed();
                self.stack.push(Value::Int(v.into()));
            }
            0x8a => {
                let n = r.u8()?;
                let value = long(r.take(n.into())?);
                self.stack.push(value);
            }
            b'G' => {
                let v = f64::from_be_bytes(r.array()?);
                self.stack.push(Value::Float(v));
            }
            b'X' | b'T' => {
                let n = r.u32()? as usize;
                let value = Value::Text(text(r.take(n)?)?);
                self.stack.push(value);
            }
            0x8c | b'U' => {
                let n = r.u8()?;
                let value = Value::Text(text(r.take(n.into())?)?);
                self.stack.push(value);
            }
            b'B' => {
                let n = r.u32()? as usize;
                r.take(n)?;
                self.stack.push(Value::Bytes);
            }
            b'C' => {
                let n = r.u8()?;
                r.take(n.into())?;
                self.stack.push(Value::Bytes);
            }
            b']' | b'}' | b')' => {
                let node = self.node(Vec::new())?;
                self.stack.push(match op {
                    b']' => Value::List(node),
                    b'}' => Value::Dict(node),
                    _ => Value::Tuple(node),
                });
            }
            b'l' | b'd' | b't' => {
                let items = self.popped_to_mark()?;
                let node = self.node(items)?;
                self.stack.push(match op {
                    b'l' => Value::List(node),
                    b'd' => Value::Dict(node),
                    _ => Value::Tuple(node),
                });
            }
            0x85..=0x87 => self.tuple(usize::from(op - 0x84))?,
            b'a' => {
                let item = self.pop()?;
                self.extend(vec![item])?;
            }
            b's' => {
                let (value, key) = (self.pop()?, self.pop()?);
                self.extend(vec![key, value])?;
            }
            b'e' | b'u' => {
                let items = self.popped_to_mark()?;
                self.extend(items)?;
            }
            b'c' => {
                let (module, name) = (r.line()?, r.line()?);
                self.global(module, name)?;
            }
            0x93 => {
                let (name, module) = (self.pop()?, self.pop()?);
                let (Value::Text(module), Value::Text(name)) = (module, name) else {
                    return Err(Fault::malformed("a global whose name is no text"));
                };
                self.global(&module, &name)?;
            }
            b'R' | 0x81 => self.call()?,
            // Attributes of an object (hooks, metadata of a state dict): dropped.
            b'b' => {
                self.pop()?;
            }
            b'Q' => self.persistent()?,
            b'q' => {
                let slot = r.u8()?;
                self.put(slot.into())?;
            }
            b'r' => {
                let slot = r.u32()?;
                self.put(slot)?;
            }
            0x94 => self.put(self.memo.len() as u32)?,
            b'h' => {
                let slot = r.u8()?;
                self.get(slot.into())?;
            }
            b'j' => {
                let slot = r.u32()?;
                self.get(slot)?;
            }
            _ => return Err(Fault::Refused(format!("the pickle uses opcode {op:#04x} at byte {at}"))),
        }
        Ok(true)
    }
}

/// A little-endian two's complement number; more than eight bytes are opaque.
fn long(bytes: &[u8]) -> Value {
    let Some(last) = bytes.last() else { return Value::Int(0) };
    if bytes.len() > 8 {
        return Value::Opaque;
    }
    let mut full = [if last & 0x80 == 0 { 0 } else { 0xff }; 8];
    full[..bytes.len()].copy_from_slice(bytes);
    Value::Int(i64::from_le_bytes(full))
}
