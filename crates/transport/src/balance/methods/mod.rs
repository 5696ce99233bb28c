//! The methods of `--balance`. A new method is a file here and a line in the table. A method of another crate is
//! [`Balance::Custom`].

pub mod efficiency_aware;
pub mod fixed;
pub mod kl;
pub mod progressive;
pub mod second_order;

use serde::{Deserialize, Serialize};

use super::{Heuristic, Method};

macro_rules! table {
    ($($variant:ident: $method:expr,)*) => {
        /// A method that divides the samples at a camera path's first surface between light and BSDF sampling: a name for
        /// each [`Method`].
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
        #[serde(into = "String", try_from = "String")]
        #[allow(missing_docs, reason = "each method's file says what it is")]
        pub enum Balance {
            $($variant,)*
            /// A method of another crate. Pictures record its name, which must be none of the others'; they cannot be read as
            /// records of a render, since the name alone does not say what the method does.
            Custom(CustomMethod),
        }

        impl Balance {
            /// The methods of this crate, in the order of the help.
            pub fn all() -> &'static [Self] {
                &[$(Self::$variant,)*]
            }

            pub fn method(self) -> &'static dyn Method {
                match self {
                    $(Self::$variant => &$method,)*
                    Self::Custom(CustomMethod(method)) => method,
                }
            }
        }
    };
}

table! {
    Progressive: progressive::Progressive,
    SecondOrder: second_order::SecondOrder,
    Kl: kl::Kl,
    EfficiencyAware: efficiency_aware::EfficiencyAware,
    Half: fixed::OneOfEach { heuristic: Heuristic::Balance, name: "half", about: "Balance heuristic, one sample of each" },
    Power: fixed::OneOfEach {
        heuristic: Heuristic::Power,
        name: "power",
        about: "Power heuristic (exponent 2), one sample of each",
    },
    Max: fixed::OneOfEach { heuristic: Heuristic::Max, name: "max", about: "Maximum heuristic, one sample of each" },
}

/// A method of another crate: `CustomMethod(&MyMethod)`, or a leaked box for one that is made at run time. Two are equal if
/// their names are.
#[derive(Clone, Copy)]
pub struct CustomMethod(pub &'static dyn Method);

impl std::fmt::Debug for CustomMethod {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.0.name())
    }
}

impl PartialEq for CustomMethod {
    fn eq(&self, other: &Self) -> bool {
        self.0.name() == other.0.name()
    }
}

impl Eq for CustomMethod {}

impl From<Balance> for String {
    fn from(balance: Balance) -> Self {
        balance.name().into()
    }
}

impl TryFrom<String> for Balance {
    type Error = String;

    fn try_from(name: String) -> Result<Self, String> {
        Self::named(&name).ok_or_else(|| format!("there is no balance method `{name}`"))
    }
}

impl Balance {
    /// The name on the command line.
    pub fn name(self) -> &'static str {
        self.method().name()
    }

    /// The method of this name, if any.
    pub fn named(name: &str) -> Option<Self> {
        Self::all().iter().copied().find(|balance| balance.name() == name)
    }
}

/// The passes of a method up to a goal.
#[cfg(test)]
fn passes(balance: Balance, goal: u32, pilot: Option<f64>) -> Vec<u32> {
    let mut done = 0;
    std::iter::from_fn(|| {
        let n = balance.method().next_pass(done, Some(goal), pilot)?;
        done += n;
        Some(n)
    })
    .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_in_files_are_those_of_the_command_line() {
        for &balance in Balance::all() {
            assert_eq!(serde_json::to_value(balance).unwrap(), balance.name());
            assert_eq!(Balance::named(balance.name()), Some(balance));
        }
        assert_eq!(Balance::named("quarter"), None);
    }
}
