//! How a line looks.

use crate::Colour;

/// Colours that stay apart for people with any colour vision (Okabe and Ito 2008).
const PALETTE: [Colour; 6] =
    [[0, 114, 178], [213, 94, 0], [0, 158, 115], [204, 121, 167], [230, 159, 0], [86, 180, 233]];

/// Colour, width and dashes of a line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stroke {
    /// Colour.
    pub colour: Colour,
    /// Pixels.
    pub width: f64,
    /// Pixels drawn and left out in turn; none for a solid line.
    pub dash: Option<[f64; 2]>,
}

impl Stroke {
    /// A broad grey line, over which others stay visible: what is compared with.
    pub fn truth() -> Self {
        Self { colour: [168, 168, 172], width: 5.0, dash: None }
    }

    /// The `i`-th of a set of lines; after six the colours repeat, dashed.
    pub fn nth(i: usize) -> Self {
        let colour = PALETTE.get(i % PALETTE.len()).copied().unwrap_or_default();
        let solid = Self { colour, width: 2.0, dash: None };
        if i < PALETTE.len() { solid } else { solid.dashed() }
    }

    /// The same, dashed.
    pub fn dashed(self) -> Self {
        Self { dash: Some([9.0, 5.0]), ..self }
    }
}
