//! Expressions of user effects: parsed, checked for dimensions, compiled to a postfix program that runs without allocation.
//!
//! ```text
//!  sum     = product { (+|-) product }          power  = atom [ ^ unary ]
//!  product = unary { (*|/) unary }              atom   = number [ '[' unit ']' ] | name | function(…) | ( sum )
//!  unary   = [ - ] power
//! ```
//! Errors carry the column, from 1, in characters. A literal 0 fits any unit.

use super::units::Dimension;
use super::variables::Variable;

/// Deepest stack that a program may need.
const STACK: usize = 32;
/// Longest program.
const MAX_OPERATIONS: usize = 512;

/// One operation of a program.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Operation {
    Constant(f64),
    Variable(Variable),
    Parameter(usize),
    Add,
    Subtract,
    Multiply,
    Divide,
    Power,
    Negate,
    Call(Function),
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Function {
    Sqrt,
    Abs,
    Sign,
    Sin,
    Cos,
    Tan,
    Tanh,
    Exp,
    Log,
    Min,
    Max,
    Hypot,
    Clamp,
}

impl Function {
    fn named(name: &str) -> Option<Self> {
        Some(match name {
            "sqrt" => Self::Sqrt,
            "abs" => Self::Abs,
            "sign" => Self::Sign,
            "sin" => Self::Sin,
            "cos" => Self::Cos,
            "tan" => Self::Tan,
            "tanh" => Self::Tanh,
            "exp" => Self::Exp,
            "log" => Self::Log,
            "min" => Self::Min,
            "max" => Self::Max,
            "hypot" => Self::Hypot,
            "clamp" => Self::Clamp,
            _ => return None,
        })
    }

    fn arguments(self) -> usize {
        match self {
            Self::Min | Self::Max | Self::Hypot => 2,
            Self::Clamp => 3,
            _ => 1,
        }
    }
}

/// A compiled expression.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Program {
    operations: Vec<Operation>,
    per_rotor: bool,
}

/// The whole text as operations, and its unit.
fn parsed<'t>(text: &str, parameters: &'t [Symbol<'t>]) -> Result<(Compiler<'t>, Unit), ExpressionError> {
    let mut compiler = Compiler {
        chars: text.chars().collect(),
        at: 0,
        parameters,
        operations: Vec::new(),
        depth: 0,
        nesting: 0,
    };
    let unit = compiler.sum()?;
    compiler.skip();
    if compiler.at < compiler.chars.len() {
        return Err(compiler.error(compiler.at, format!("unexpected `{}`", compiler.chars[compiler.at])));
    }
    Ok((compiler, unit))
}

/// Dimension of an expression of variables alone.
pub(super) fn dimension(text: &str) -> Result<Dimension, ExpressionError> {
    parsed(text, &[]).map(|(_, unit)| unit.dimension())
}

/// What is wrong with an expression, and at which column.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct ExpressionError {
    pub(super) column: usize,
    pub(super) reason: String,
}

/// A parameter as expressions see it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Symbol<'t> {
    pub(super) name: &'t str,
    pub(super) dimension: Dimension,
}

impl Program {
    /// Compiles `text`, whose value must have the dimension `expected`.
    pub(super) fn compile(text: &str, parameters: &[Symbol<'_>], expected: Dimension) -> Result<Self, ExpressionError> {
        let (compiler, value) = parsed(text, parameters)?;
        if !value.fits(expected) {
            let reason = format!("expected a value in {expected}, this expression gives {value}");
            return Err(compiler.error(0, reason));
        }
        let per_rotor = compiler
            .operations
            .iter()
            .any(|op| matches!(op, Operation::Variable(v) if v.per_rotor()));
        Ok(Self {
            operations: compiler.operations,
            per_rotor,
        })
    }

    /// True if the value differs from rotor to rotor.
    pub(super) fn per_rotor(&self) -> bool {
        self.per_rotor
    }

    /// The variables in use.
    pub(super) fn variables(&self) -> impl Iterator<Item = Variable> {
        self.operations.iter().filter_map(|op| match op {
            Operation::Variable(variable) => Some(*variable),
            _ => None,
        })
    }

    /// True if a parameter is used.
    pub(super) fn uses_parameter(&self, index: usize) -> bool {
        self.operations.contains(&Operation::Parameter(index))
    }

    /// The value.
    #[inline]
    pub(super) fn value(&self, parameters: &[f64], variable: impl Fn(Variable) -> f64) -> f64 {
        let mut stack = [0.0; STACK];
        let mut top = 0;
        for operation in &self.operations {
            match *operation {
                Operation::Constant(value) => {
                    stack[top] = value;
                    top += 1;
                }
                Operation::Variable(name) => {
                    stack[top] = variable(name);
                    top += 1;
                }
                Operation::Parameter(index) => {
                    stack[top] = parameters[index];
                    top += 1;
                }
                Operation::Negate => stack[top - 1] = -stack[top - 1],
                Operation::Call(function) => {
                    let count = function.arguments();
                    top -= count;
                    stack[top] = call(function, &stack[top..top + count]);
                    top += 1;
                }
                binary => {
                    top -= 1;
                    let (a, b) = (stack[top - 1], stack[top]);
                    stack[top - 1] = match binary {
                        Operation::Add => a + b,
                        Operation::Subtract => a - b,
                        Operation::Multiply => a * b,
                        Operation::Divide => a / b,
                        _ => power(a, b),
                    };
                }
            }
        }
        stack[0]
    }
}

/// Whole powers by multiplication, so that a negative base is allowed.
fn power(a: f64, b: f64) -> f64 {
    if b == 2.0 {
        return a * a;
    }
    if b.fract() == 0.0 && b.abs() <= 16.0 {
        let mut result = 1.0;
        for _ in 0..b.abs() as u32 {
            result *= a;
        }
        return if b < 0.0 { 1.0 / result } else { result };
    }
    libm::pow(a, b)
}

fn call(function: Function, x: &[f64]) -> f64 {
    match function {
        Function::Sqrt => x[0].sqrt(),
        Function::Abs => x[0].abs(),
        Function::Sign => {
            if x[0] > 0.0 {
                1.0
            } else if x[0] < 0.0 {
                -1.0
            } else {
                0.0
            }
        }
        Function::Sin => libm::sin(x[0]),
        Function::Cos => libm::cos(x[0]),
        Function::Tan => libm::tan(x[0]),
        Function::Tanh => libm::tanh(x[0]),
        Function::Exp => libm::exp(x[0]),
        Function::Log => libm::log(x[0]),
        Function::Min => x[0].min(x[1]),
        Function::Max => x[0].max(x[1]),
        Function::Hypot => (x[0] * x[0] + x[1] * x[1]).sqrt(),
        Function::Clamp => x[0].max(x[1]).min(x[2]),
    }
}

/// Unit of a part of the expression; a literal 0 has any.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Unit {
    Any,
    Known(Dimension),
}

impl Unit {
    fn fits(self, dimension: Dimension) -> bool {
        self == Self::Any || self == Self::Known(dimension)
    }

    /// The unit of both, if they agree.
    fn join(self, other: Self) -> Option<Self> {
        match (self, other) {
            (Self::Any, unit) | (unit, Self::Any) => Some(unit),
            (a, b) => (a == b).then_some(a),
        }
    }

    fn dimension(self) -> Dimension {
        match self {
            Self::Any => Dimension::NONE,
            Self::Known(dimension) => dimension,
        }
    }
}

impl std::fmt::Display for Unit {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.dimension().fmt(out)
    }
}

struct Compiler<'t> {
    chars: Vec<char>,
    at: usize,
    parameters: &'t [Symbol<'t>],
    operations: Vec<Operation>,
    depth: usize,
    nesting: usize,
}

type Parsed = Result<Unit, ExpressionError>;

impl Compiler<'_> {
    fn error(&self, at: usize, reason: impl Into<String>) -> ExpressionError {
        ExpressionError {
            column: at + 1,
            reason: reason.into(),
        }
    }

    fn skip(&mut self) {
        while self.chars.get(self.at).is_some_and(|c| c.is_whitespace()) {
            self.at += 1;
        }
    }

    /// Takes `wanted` if it is next.
    fn take(&mut self, wanted: char) -> bool {
        self.skip();
        let there = self.chars.get(self.at) == Some(&wanted);
        self.at += usize::from(there);
        there
    }

    fn push(&mut self, operation: Operation) -> Result<(), ExpressionError> {
        self.depth = match operation {
            Operation::Constant(_) | Operation::Variable(_) | Operation::Parameter(_) => self.depth + 1,
            Operation::Negate => self.depth,
            Operation::Call(function) => self.depth + 1 - function.arguments(),
            _ => self.depth - 1,
        };
        if self.depth > STACK || self.operations.len() >= MAX_OPERATIONS {
            return Err(self.error(self.at, "the expression is too long or nested too deeply"));
        }
        self.operations.push(operation);
        Ok(())
    }

    fn sum(&mut self) -> Parsed {
        self.nesting += 1;
        if self.nesting > STACK {
            return Err(self.error(self.at, "the expression is nested too deeply"));
        }
        let mut unit = self.product()?;
        loop {
            self.skip();
            let at = self.at;
            let operation = if self.take('+') {
                Operation::Add
            } else if self.take('-') {
                Operation::Subtract
            } else {
                self.nesting -= 1;
                return Ok(unit);
            };
            let right = self.product()?;
            unit = unit.join(right).ok_or_else(|| {
                let word = if operation == Operation::Add { "add" } else { "subtract" };
                self.error(at, format!("cannot {word} {unit} and {right}"))
            })?;
            self.push(operation)?;
        }
    }

    fn product(&mut self) -> Parsed {
        let mut unit = self.unary()?;
        loop {
            if self.take('*') {
                let right = self.unary()?;
                unit = match (unit, right) {
                    (Unit::Any, _) | (_, Unit::Any) => Unit::Any,
                    (Unit::Known(a), Unit::Known(b)) => Unit::Known(a.times(b)),
                };
                self.push(Operation::Multiply)?;
            } else if self.take('/') {
                let right = self.unary()?;
                unit = match unit {
                    Unit::Any => Unit::Any,
                    Unit::Known(a) => Unit::Known(a.per(right.dimension())),
                };
                self.push(Operation::Divide)?;
            } else {
                return Ok(unit);
            }
        }
    }

    fn unary(&mut self) -> Parsed {
        if self.take('-') {
            self.nesting += 1;
            if self.nesting > STACK {
                return Err(self.error(self.at, "the expression is nested too deeply"));
            }
            let unit = self.unary()?;
            self.nesting -= 1;
            self.push(Operation::Negate)?;
            return Ok(unit);
        }
        self.power()
    }

    fn power(&mut self) -> Parsed {
        let base = self.atom()?;
        self.skip();
        let at = self.at;
        if !self.take('^') {
            return Ok(base);
        }
        let before = self.operations.len();
        let exponent = self.unary()?;
        if !exponent.fits(Dimension::NONE) {
            return Err(self.error(at, format!("expected an exponent without unit, got {exponent}")));
        }
        let unit = if base.fits(Dimension::NONE) {
            base
        } else {
            let literal = match self.operations[before..] {
                [Operation::Constant(value)] => Some(value),
                [Operation::Constant(value), Operation::Negate] => Some(-value),
                _ => None,
            };
            let halves = literal
                .map(|value| 2.0 * value)
                .filter(|halves| halves.fract() == 0.0 && halves.abs() <= 12.0);
            let result = halves.and_then(|halves| base.dimension().power(halves as i8));
            Unit::Known(result.ok_or_else(|| {
                let reason = format!("{base} needs a literal exponent, a multiple of a half that leaves a unit");
                self.error(at, reason)
            })?)
        };
        self.push(Operation::Power)?;
        Ok(unit)
    }

    fn atom(&mut self) -> Parsed {
        self.skip();
        let at = self.at;
        let Some(&first) = self.chars.get(at) else {
            return Err(self.error(at, "the expression ends where a value was expected"));
        };
        if self.take('(') {
            let unit = self.sum()?;
            if !self.take(')') {
                return Err(self.error(self.at, "a `)` is missing"));
            }
            return Ok(unit);
        }
        if first.is_ascii_digit() || first == '.' {
            return self.number(at);
        }
        if !(first.is_alphabetic() || first == '_') {
            return Err(self.error(at, format!("expected a value, got `{first}`")));
        }
        while self
            .chars
            .get(self.at)
            .is_some_and(|c| c.is_alphanumeric() || *c == '_')
        {
            self.at += 1;
        }
        let name: String = self.chars[at..self.at].iter().collect();
        if self.take('(') {
            return self.call(at, &name);
        }
        if let Some(index) = self.parameters.iter().position(|p| p.name == name) {
            self.push(Operation::Parameter(index))?;
            return Ok(Unit::Known(self.parameters[index].dimension));
        }
        if name == "pi" {
            self.push(Operation::Constant(std::f64::consts::PI))?;
            return Ok(Unit::Known(Dimension::NONE));
        }
        match Variable::named(&name) {
            Some(variable) => {
                self.push(Operation::Variable(variable))?;
                Ok(Unit::Known(variable.dimension()))
            }
            None => Err(self.error(
                at,
                format!("`{name}` is neither a parameter of this effect nor a variable"),
            )),
        }
    }

    fn number(&mut self, at: usize) -> Parsed {
        let is_part = |c: char, before: char| {
            c.is_ascii_digit()
                || matches!(c, '.' | 'e' | 'E')
                || (matches!(c, '+' | '-') && matches!(before, 'e' | 'E'))
        };
        while let Some(&c) = self.chars.get(self.at)
            && is_part(c, if self.at > at { self.chars[self.at - 1] } else { ' ' })
        {
            self.at += 1;
        }
        let text: String = self.chars[at..self.at].iter().collect();
        let value = text.parse::<f64>().ok().filter(|value| value.is_finite());
        let value = value.ok_or_else(|| self.error(at, format!("expected a number, got `{text}`")))?;
        self.push(Operation::Constant(value))?;
        if self.take('[') {
            let from = self.at;
            while self.chars.get(self.at).is_some_and(|c| *c != ']') {
                self.at += 1;
            }
            let unit: String = self.chars[from..self.at].iter().collect();
            if !self.take(']') {
                return Err(self.error(from, "a `]` is missing"));
            }
            let dimension = Dimension::parse(&unit).map_err(|reason| self.error(from, reason))?;
            return Ok(Unit::Known(dimension));
        }
        Ok(if value == 0.0 {
            Unit::Any
        } else {
            Unit::Known(Dimension::NONE)
        })
    }

    fn call(&mut self, at: usize, name: &str) -> Parsed {
        let function = Function::named(name).ok_or_else(|| self.error(at, format!("`{name}` is not a function")))?;
        let mut units = Vec::new();
        loop {
            units.push(self.sum()?);
            if !self.take(',') {
                break;
            }
        }
        if !self.take(')') {
            return Err(self.error(self.at, "a `)` is missing"));
        }
        if units.len() != function.arguments() {
            let reason = format!("`{name}` takes {} values, got {}", function.arguments(), units.len());
            return Err(self.error(at, reason));
        }
        let unit = match function {
            Function::Abs => units[0],
            Function::Sign => Unit::Known(Dimension::NONE),
            Function::Sqrt => match units[0] {
                Unit::Any => Unit::Any,
                Unit::Known(dimension) => Unit::Known(
                    dimension
                        .power(1)
                        .ok_or_else(|| self.error(at, format!("{dimension} has no square root")))?,
                ),
            },
            Function::Min | Function::Max | Function::Hypot | Function::Clamp => {
                let joined = units.iter().try_fold(Unit::Any, |sum, unit| sum.join(*unit));
                joined.ok_or_else(|| self.error(at, format!("the values of `{name}` differ in unit")))?
            }
            _ if units[0].fits(Dimension::NONE) => Unit::Known(Dimension::NONE),
            _ => return Err(self.error(at, format!("`{name}` takes a value without unit, got {}", units[0]))),
        };
        self.push(Operation::Call(function))?;
        Ok(unit)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PARAMETERS: [Symbol<'_>; 2] = [
        Symbol {
            name: "k",
            dimension: Dimension::FORCE,
        },
        Symbol {
            name: "share",
            dimension: Dimension::NONE,
        },
    ];

    fn value(text: &str, expected: Dimension) -> f64 {
        let program = Program::compile(text, &PARAMETERS, expected).unwrap_or_else(|e| panic!("{text}: {e:?}"));
        program.value(&[3.0, 0.5], |_| 2.0)
    }

    #[test]
    fn val_values_by_hand() {
        let none = Dimension::NONE;
        for (text, expected) in [
            ("1 + 2 * 3 - 4 / 8", 6.5),
            ("-2^2", -4.0),
            ("2^-1", 0.5),
            ("2^3^1 + (1 - 3)^2", 12.0),
            ("sqrt(16) + abs(-3) + sign(-2)", 6.0),
            ("max(0, min(5, 7)) + hypot(3, 4)", 10.0),
            ("clamp(9, 0, share)", 0.5),
            ("exp(0) + cos(0) + log(1) + tanh(0) + sin(pi - pi)", 2.0),
            ("1.5e1 * 2e-1", 3.0),
        ] {
            assert_eq!(value(text, none), expected, "{text}");
        }
        assert_eq!(value("k * air_velocity_x / 2[m/s]", Dimension::FORCE), 3.0);
        assert_eq!(value("k * (air_velocity_x / 1[m/s])^2", Dimension::FORCE), 12.0);
        assert_eq!(value("sqrt(k^2)", Dimension::FORCE), 3.0);
    }

    #[test]
    fn val_errors_name_the_column() {
        for (text, column, part) in [
            ("k * air_velocity_x", 1, "expected a value in N"),
            ("k + air_velocity_x", 3, "cannot add N and"),
            ("k * (1 + ", 10, "ends where a value"),
            ("k * (1 + 2", 11, "`)` is missing"),
            ("k * spped", 5, "`spped` is neither"),
            ("k * sin(k)", 5, "takes a value without unit"),
            ("k * foo(1)", 5, "is not a function"),
            ("k * max(1)", 5, "takes 2 values, got 1"),
            ("k $ 2", 3, "unexpected `$`"),
            ("k * 2[mm]", 7, "without prefix"),
            ("k ^ share", 3, "literal exponent"),
            ("k * 1.2.3", 5, "expected a number"),
            ("", 1, "ends where"),
        ] {
            let error = Program::compile(text, &PARAMETERS, Dimension::FORCE).expect_err(text);
            assert_eq!(error.column, column, "{text}: {}", error.reason);
            assert!(error.reason.contains(part), "{text}: {}", error.reason);
        }
        let deep = "(".repeat(100) + "1" + &")".repeat(100);
        assert!(Program::compile(&deep, &[], Dimension::NONE).is_err());
        let deep = "-".repeat(100_000) + "1";
        assert!(Program::compile(&deep, &[], Dimension::NONE).is_err());
    }

    proptest::proptest! {
        #![proptest_config(proptest::prelude::ProptestConfig::with_cases(64))]
        #[test]
        fn prop_no_text_breaks_the_compiler(text in "[-+*/^()a-z0-9. ,\\[\\]]{0,60}") {
            if let Ok(program) = Program::compile(&text, &PARAMETERS, Dimension::NONE) {
                program.value(&[1.0, 1.0], |_| 1.0);
            }
        }
    }
}
