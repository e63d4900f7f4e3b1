//! A dense network with one hidden layer and a softmax output: forward, loss and gradient over a mini-batch.
//!
//! h = σ(x W₁ + b₁),   y = softmax(h W₂ + b₂),   loss = −mean ln y(label)
//!
//! Matrices are stored by input (`W[input][neuron]`), so that a batch is one product. σ is ReLU (§5.2) or the logistic function
//! ([32]).

use super::matrix::{Left, Matrix, multiply_add};
use rotortwin_plant::random::RandomStream;

/// σ of the hidden layer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Activation {
    /// max(0, x).
    Relu,
    /// 1/(1 + e⁻ˣ).
    Sigmoid,
}

/// Number of inputs, hidden neurons and classes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shape {
    /// Features.
    pub inputs: usize,
    /// Hidden neurons.
    pub hidden: usize,
    /// Classes.
    pub classes: usize,
}

/// Parameters of a network; also used for anything of the same shape, such as a gradient.
#[derive(Clone, Debug, PartialEq)]
pub struct Parameters {
    /// W₁, inputs × hidden.
    pub hidden_weight: Matrix,
    /// b₁, one row.
    pub hidden_bias: Matrix,
    /// W₂, hidden × classes.
    pub output_weight: Matrix,
    /// b₂, one row.
    pub output_bias: Matrix,
}

impl Parameters {
    /// All zero.
    pub fn zero(shape: Shape) -> Self {
        Self {
            hidden_weight: Matrix::new(shape.inputs, shape.hidden),
            hidden_bias: Matrix::new(1, shape.hidden),
            output_weight: Matrix::new(shape.hidden, shape.classes),
            output_bias: Matrix::new(1, shape.classes),
        }
    }

    /// Weights uniform in ±√(6/(inputs + outputs)) of their layer (Glorot), biases 0.
    pub fn random(shape: Shape, random: &mut RandomStream) -> Self {
        let mut weights = |inputs: usize, outputs: usize| {
            let bound = (6.0 / (inputs + outputs) as f64).sqrt();
            Matrix::from_fn(inputs, outputs, |_, _| bound * random.symmetric())
        };
        Self {
            hidden_weight: weights(shape.inputs, shape.hidden),
            output_weight: weights(shape.hidden, shape.classes),
            ..Self::zero(shape)
        }
    }

    /// Sizes.
    pub fn shape(&self) -> Shape {
        Shape {
            inputs: self.hidden_weight.rows(),
            hidden: self.hidden_weight.columns(),
            classes: self.output_weight.columns(),
        }
    }

    /// The four blocks, and whether each holds weights (which are regularised) or biases (which are not).
    pub fn blocks_mut(&mut self) -> [(&mut Matrix, bool); 4] {
        [
            (&mut self.hidden_weight, true),
            (&mut self.hidden_bias, false),
            (&mut self.output_weight, true),
            (&mut self.output_bias, false),
        ]
    }

    /// The four blocks, as in [`Parameters::blocks_mut`].
    pub fn blocks(&self) -> [&Matrix; 4] {
        [
            &self.hidden_weight,
            &self.hidden_bias,
            &self.output_weight,
            &self.output_bias,
        ]
    }
}

/// Workspace for batches of up to a fixed number of samples.
#[derive(Clone, Debug)]
pub struct Workspace {
    activation: Activation,
    hidden: Matrix,
    output: Matrix,
    hidden_error: Matrix,
    output_weight_transposed: Matrix,
    ones: Matrix,
    pack: Vec<f64>,
}

impl Workspace {
    /// For networks of this shape and batches of up to `batch` samples.
    pub fn new(shape: Shape, activation: Activation, batch: usize) -> Self {
        Self {
            activation,
            hidden: Matrix::new(batch, shape.hidden),
            output: Matrix::new(batch, shape.classes),
            hidden_error: Matrix::new(batch, shape.hidden),
            output_weight_transposed: Matrix::new(shape.classes, shape.hidden),
            ones: Matrix::from_fn(batch, 1, |_, _| 1.0),
            pack: Vec::new(),
        }
    }

    /// Class probabilities of the first `count` rows of `x`, stored in [`Workspace::probabilities`].
    pub fn forward(&mut self, network: &Parameters, x: &Matrix, count: usize) {
        let shape = network.shape();
        for i in 0..count {
            self.hidden.row_mut(i).copy_from_slice(network.hidden_bias.row(0));
            self.output.row_mut(i).copy_from_slice(network.output_bias.row(0));
        }
        multiply_add(
            count,
            shape.inputs,
            x,
            Left::AsIs,
            &network.hidden_weight,
            &mut self.hidden,
            &mut self.pack,
        );
        match self.activation {
            Activation::Relu => self.hidden.padded_mut().iter_mut().for_each(|h| *h = h.max(0.0)),
            Activation::Sigmoid => {
                for i in 0..count {
                    self.hidden
                        .row_mut(i)
                        .iter_mut()
                        .for_each(|h| *h = 1.0 / (1.0 + libm::exp(-*h)));
                }
            }
        }
        multiply_add(
            count,
            shape.hidden,
            &self.hidden,
            Left::AsIs,
            &network.output_weight,
            &mut self.output,
            &mut self.pack,
        );
        for i in 0..count {
            softmax(self.output.row_mut(i));
        }
    }

    /// Class probabilities of sample `i` of the last [`Workspace::forward`].
    pub fn probabilities(&self, i: usize) -> &[f64] {
        self.output.row(i)
    }

    /// Mean cross-entropy of the first `count` rows of `x` and its gradient.
    pub fn gradient(&mut self, network: &Parameters, x: &Matrix, labels: &[u8], gradient: &mut Parameters) -> f64 {
        let count = labels.len();
        let shape = network.shape();
        self.forward(network, x, count);
        let mut loss = 0.0;
        let weight = 1.0 / count as f64;
        // ∂loss/∂(h W₂ + b₂) = (y − 1(label))/count
        for (i, label) in labels.iter().enumerate() {
            let output = self.output.row_mut(i);
            loss -= libm::log(output[usize::from(*label)]);
            output[usize::from(*label)] -= 1.0;
            output.iter_mut().for_each(|error| *error *= weight);
        }
        for (block, _) in gradient.blocks_mut() {
            block.padded_mut().fill(0.0);
        }
        self.output_weight_transposed.transpose_of(&network.output_weight);
        self.hidden_error.padded_mut().fill(0.0);
        multiply_add(
            count,
            shape.classes,
            &self.output,
            Left::AsIs,
            &self.output_weight_transposed,
            &mut self.hidden_error,
            &mut self.pack,
        );
        let slopes = self.hidden_error.padded_mut().iter_mut().zip(self.hidden.padded());
        match self.activation {
            Activation::Relu => slopes.for_each(|(error, h)| *error = if *h > 0.0 { *error } else { 0.0 }),
            Activation::Sigmoid => slopes.for_each(|(error, h)| *error *= h * (1.0 - h)),
        }
        let mut sum = |rows, a: &Matrix, b: &Matrix, c: &mut Matrix| {
            multiply_add(rows, count, a, Left::Transposed, b, c, &mut self.pack);
        };
        sum(shape.inputs, x, &self.hidden_error, &mut gradient.hidden_weight);
        sum(1, &self.ones, &self.hidden_error, &mut gradient.hidden_bias);
        sum(shape.hidden, &self.hidden, &self.output, &mut gradient.output_weight);
        sum(1, &self.ones, &self.output, &mut gradient.output_bias);
        loss * weight
    }
}

/// Shifted by the maximum, so that nothing overflows.
fn softmax(values: &mut [f64]) {
    let largest = values.iter().fold(f64::NEG_INFINITY, |a, b| a.max(*b));
    let mut sum = 0.0;
    for value in values.iter_mut() {
        *value = libm::exp(*value - largest);
        sum += *value;
    }
    values.iter_mut().for_each(|value| *value /= sum);
}

/// Index of the maximum; ties go to the first.
pub fn arg_max(values: &[f64]) -> usize {
    let mut best = 0;
    for (i, value) in values.iter().enumerate() {
        if *value > values[best] {
            best = i;
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Central differences over 1e-5: truncation 1e-10 relative, rounding 1e-11.
    const DIFFERENCE_TOLERANCE: f64 = 1e-8;

    /// The gradient compared with finite differences of the loss, for both activations.
    #[test]
    fn val_gradient_against_differences() {
        let shape = Shape {
            inputs: 5,
            hidden: 7,
            classes: 3,
        };
        for activation in [Activation::Relu, Activation::Sigmoid] {
            let mut random = RandomStream::new(3, "gradient");
            let mut network = Parameters::random(shape, &mut random);
            for (block, _) in network.blocks_mut() {
                for i in 0..block.rows() {
                    block.row_mut(i).iter_mut().for_each(|w| *w += 0.1 * random.symmetric());
                }
            }
            let x = Matrix::from_fn(6, shape.inputs, |_, _| 2.0 * random.symmetric());
            let labels = [0, 1, 2, 2, 1, 0];
            let mut work = Workspace::new(shape, activation, 6);
            let mut gradient = Parameters::zero(shape);
            work.gradient(&network, &x, &labels, &mut gradient);
            let mut scratch = Parameters::zero(shape);
            let mut largest: f64 = 0.0;
            for block in 0..4 {
                let (rows, columns) = (gradient.blocks()[block].rows(), gradient.blocks()[block].columns());
                for i in 0..rows {
                    for j in 0..columns {
                        let mut loss = |step: f64| {
                            let mut moved = network.clone();
                            moved.blocks_mut()[block].0.row_mut(i)[j] += step;
                            work.gradient(&moved, &x, &labels, &mut scratch)
                        };
                        let difference = (loss(1e-5) - loss(-1e-5)) / 2e-5;
                        let got = gradient.blocks()[block].row(i)[j];
                        largest = largest.max(got.abs());
                        assert!((got - difference).abs() < DIFFERENCE_TOLERANCE, "{got} {difference}");
                    }
                }
            }
            assert!(largest > 0.01, "a gradient of zero would have passed");
        }
    }
}
