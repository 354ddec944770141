//! A trained policy as an ONNX model, which other programs run without this one.
//!
//! Inputs are `observation` (batch × inputs, f32) and `action_mask` (batch × A, bool). Outputs are `q_heads` (batch × K × A, in units of scaled
//! reward), `q` (batch × A, their mean over the heads) and `action` (batch, i64): the vote of the heads among the allowed actions; of equally many
//! votes the larger mean value, then the lower index. Operators of set 17: a layer of all heads is one product of matrices.

use lanecraft_net::Ensemble;
use lanecraft_net::protobuf::Message;

use crate::{Policy, Readout};

/// Version of the file format, and of the set of operators.
const IR_VERSION: u64 = 8;
const OPERATOR_SET: u64 = 17;
/// Element types of the format.
const FLOAT: u64 = 1;
const INT64: u64 = 7;
const BOOL: u64 = 9;
/// Below every value that a network gives.
const LOWEST: f32 = f32::MIN;

impl Policy {
    /// The policy as the bytes of an ONNX model.
    pub fn to_onnx(&self) -> Vec<u8> {
        let mut graph = Graph::default();
        let estimates = graph.estimates(self);
        graph.vote(&estimates, self.actions());
        let inputs = [value("observation", FLOAT, &[self.inputs()]), value("action_mask", BOOL, &[self.actions()])];
        let outputs = [
            value("q_heads", FLOAT, &[self.heads(), self.actions()]),
            value("q", FLOAT, &[self.actions()]),
            value("action", INT64, &[]),
        ];
        let graph = Message::default()
            .messages(1, graph.nodes)
            .bytes(2, "policy")
            .messages(5, graph.constants)
            .messages(11, inputs)
            .messages(12, outputs);
        Message::default()
            .integer(1, IR_VERSION)
            .bytes(2, "lanecraft")
            .bytes(3, env!("CARGO_PKG_VERSION"))
            .message(7, &graph)
            .message(8, &Message::default().bytes(1, "").integer(2, OPERATOR_SET))
            .into_bytes()
    }
}

/// A graph that is being written; results have names.
#[derive(Default)]
struct Graph {
    nodes: Vec<Message>,
    constants: Vec<Message>,
}

impl Graph {
    /// The estimates of all heads, K × batch × (A · estimates of an action).
    fn estimates(&mut self, policy: &Policy) -> String {
        let axis = self.integers("axis_0", &[0]);
        let rows = self.node("Unsqueeze", &["observation", &axis], "rows", &[]);
        let outputs = self.passes(policy.network(), &rows, "network");
        let read = self.read(policy, &outputs);
        let Some((prior, scale)) = policy.prior() else { return read };
        let outputs = self.passes(prior, &rows, "prior");
        let scale = self.floats("prior_scale", &[1], &[scale]);
        let scaled = self.node("Mul", &[&outputs, &scale], "prior_scaled", &[]);
        self.node("Add", &[&read, &scaled], "estimates", &[])
    }

    /// Layer by layer: copies × batch × outputs.
    fn passes(&mut self, network: &Ensemble, rows: &str, part: &str) -> String {
        let tensors = network.shape().tensors();
        let last = tensors.len() / 2 - 1;
        let mut at = rows.to_owned();
        for (index, layer) in tensors.chunks_exact(2).enumerate() {
            let [weight, bias] = [&layer[0], &layer[1]];
            let values = network.parameters();
            let name = |of: &str| format!("{part}.{of}");
            let weights = self.floats(&name(&weight.name), &weight.shape, &values[weight.range.clone()]);
            let biases = [bias.shape[0], 1, bias.shape[1]];
            let biases = self.floats(&name(&bias.name), &biases, &values[bias.range.clone()]);
            let product = self.node("MatMul", &[&at, &weights], &name(&format!("product.{index}")), &[]);
            at = self.node("Add", &[&product, &biases], &name(&format!("sum.{index}")), &[]);
            if index < last {
                at = self.node("Relu", &[&at], &name(&format!("rectified.{index}")), &[]);
            }
        }
        at
    }

    /// What a [`Readout`] makes of the outputs of the ensemble.
    fn read(&mut self, policy: &Policy, outputs: &str) -> String {
        let Readout::Dueling = policy.readout() else { return outputs.to_owned() };
        let heads = self.integers("streams", &[policy.heads() as i64; 2]);
        self.split(&[outputs, &heads], ["value_stream", "advantages"]);
        let [from, to, axis] =
            [("first", 0), ("second", 1), ("last_axis", 2)].map(|(name, value)| self.integers(name, &[value]));
        let value = self.node("Slice", &["value_stream", &from, &to, &axis], "value", &[]);
        let mean = self.node("ReduceMean", &["advantages"], "mean_advantage", &[("axes", Attribute::Integers(&[2]))]);
        let centered = self.node("Sub", &["advantages", &mean], "centered_advantages", &[]);
        self.node("Add", &[&value, &centered], "dueling", &[])
    }

    /// From estimates to the three outputs.
    fn vote(&mut self, estimates: &str, actions: usize) {
        let shape = self.integers("per_action", &[0, 0, actions as i64, -1]);
        let apart = self.node("Reshape", &[estimates, &shape], "per_action_estimates", &[]);
        let last = [("axes", Attribute::Integers(&[3])), ("keepdims", Attribute::Integer(0))];
        let by_head = self.node("ReduceMean", &[&apart], "q_by_head", &last);
        self.node("Transpose", &[&by_head], "q_heads", &[("perm", Attribute::Integers(&[1, 0, 2]))]);
        let over_heads = [("axes", Attribute::Integers(&[1])), ("keepdims", Attribute::Integer(0))];
        self.node("ReduceMean", &["q_heads"], "q", &over_heads);

        let [axis, lowest] = [self.integers("axis_1", &[1]), self.floats("lowest", &[1], &[LOWEST])];
        let mask = self.node("Unsqueeze", &["action_mask", &axis], "mask_of_heads", &[]);
        let allowed = self.node("Where", &[&mask, "q_heads", &lowest], "allowed_q_heads", &[]);
        let best = [("axis", Attribute::Integer(2)), ("keepdims", Attribute::Integer(0))];
        let choices = self.node("ArgMax", &[&allowed], "choices", &best);
        let [depth, ends] = [self.integers("actions", &[actions as i64]), self.floats("off_and_on", &[2], &[0.0, 1.0])];
        let ballots = self.node("OneHot", &[&choices, &depth, &ends], "ballots", &[]);
        let counted = self.node("ReduceSum", &[&ballots, &axis], "votes", &[("keepdims", Attribute::Integer(0))]);
        let counted = self.node("Where", &["action_mask", &counted, &lowest], "allowed_votes", &[]);
        let most = self.node("ReduceMax", &[&counted], "most_votes", &[("axes", Attribute::Integers(&[1]))]);
        let ahead = self.node("Equal", &[&counted, &most], "ahead", &[]);
        let values = self.node("Where", &[&ahead, "q", &lowest], "values_of_those_ahead", &[]);
        self.node(
            "ArgMax",
            &[&values],
            "action",
            &[("axis", Attribute::Integer(1)), ("keepdims", Attribute::Integer(0))],
        );
    }

    /// An operator with one result, whose name it returns.
    fn node(&mut self, operator: &str, inputs: &[&str], output: &str, attributes: &[(&str, Attribute<'_>)]) -> String {
        let named = inputs.iter().fold(Message::default(), |message, input| message.bytes(1, input));
        let message = named.bytes(2, output).bytes(3, output).bytes(4, operator);
        self.nodes.push(message.messages(5, attributes.iter().map(|(name, attribute)| attribute.message(name))));
        output.to_owned()
    }

    /// Splits the first axis into two.
    fn split(&mut self, inputs: &[&str], outputs: [&str; 2]) {
        let named = inputs.iter().fold(Message::default(), |message, input| message.bytes(1, input));
        let message = outputs.iter().fold(named, |message, output| message.bytes(2, output));
        self.nodes.push(
            message.bytes(3, "streams_apart").bytes(4, "Split").message(5, &Attribute::Integer(0).message("axis")),
        );
    }

    fn floats(&mut self, name: &str, shape: &[usize], values: &[f32]) -> String {
        let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        self.constant(name, FLOAT, shape, &bytes)
    }

    fn integers(&mut self, name: &str, values: &[i64]) -> String {
        let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        self.constant(name, INT64, &[values.len()], &bytes)
    }

    fn constant(&mut self, name: &str, element: u64, shape: &[usize], bytes: &[u8]) -> String {
        let dims = shape.iter().fold(Message::default(), |message, size| message.integer(1, *size as u64));
        self.constants.push(dims.integer(2, element).bytes(8, name).bytes(9, bytes));
        name.to_owned()
    }
}

/// An attribute of an operator.
enum Attribute<'a> {
    Integer(u64),
    Integers(&'a [u64]),
}

impl Attribute<'_> {
    fn message(&self, name: &str) -> Message {
        let named = Message::default().bytes(1, name);
        match self {
            Self::Integer(value) => named.integer(3, *value).integer(20, 2),
            Self::Integers(values) => {
                values.iter().fold(named, |message, value| message.integer(8, *value)).integer(20, 7)
            }
        }
    }
}

/// An input or output of the model: a batch of any size × `shape`.
fn value(name: &str, element: u64, shape: &[usize]) -> Message {
    let batch = Message::default().bytes(2, "batch");
    let sizes = shape.iter().map(|size| Message::default().integer(1, *size as u64));
    let shape = Message::default().messages(1, std::iter::once(batch).chain(sizes));
    let tensor = Message::default().integer(1, element).message(2, &shape);
    Message::default().bytes(1, name).message(2, &Message::default().message(1, &tensor))
}
