//! One thing that was looked at.

use std::fmt::{Display, Formatter};

use serde_json::{Value, json};

/// How bad it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Grade {
    Good,
    /// A run is worse for it.
    Advice,
    /// No run is possible.
    Fault,
}

impl Grade {
    fn word(self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::Advice => "advice",
            Self::Fault => "fault",
        }
    }
}

/// What was found, and what to do.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Finding {
    pub(crate) topic: &'static str,
    pub(crate) grade: Grade,
    pub(crate) text: String,
    pub(crate) remedy: String,
}

impl Finding {
    pub(crate) fn good(topic: &'static str, text: impl Into<String>) -> Self {
        Self { topic, grade: Grade::Good, text: text.into(), remedy: String::new() }
    }

    pub(crate) fn advice(topic: &'static str, text: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self { topic, grade: Grade::Advice, text: text.into(), remedy: remedy.into() }
    }

    pub(crate) fn fault(topic: &'static str, text: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self { topic, grade: Grade::Fault, text: text.into(), remedy: remedy.into() }
    }

    pub(crate) fn as_json(&self) -> Value {
        json!({ "topic": self.topic, "grade": self.grade.word(), "text": self.text, "remedy": self.remedy })
    }
}

impl Display for Finding {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> std::fmt::Result {
        write!(formatter, "{:<7} {:<14} {}", self.grade.word(), self.topic, self.text)?;
        if self.remedy.is_empty() { Ok(()) } else { write!(formatter, "\n{:<22} -> {}", "", self.remedy) }
    }
}
