//! Smooth letters: the dots of the font, joined by strokes with round ends.

use crate::font;

/// Where a text stands relative to its anchor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Align {
    Left,
    Centre,
    Right,
}

/// Width of a stroke, dots.
pub(crate) const WEIGHT: f64 = 1.15;

/// Dots between two letters.
const GAP: f64 = 1.25;

/// Width of a text in dots.
pub(crate) fn width(text: &str) -> f64 {
    let letters: f64 = text.chars().map(|character| columns(character).1 + GAP).sum();
    (letters - GAP).max(0.0)
}

/// The strokes of a text in dots, x from its anchor to the right and y from the middle of its capitals down.
pub(crate) fn strokes(text: &str, align: Align) -> Vec<[[f64; 2]; 2]> {
    let mut left = match align {
        Align::Left => 0.0,
        Align::Centre => -width(text) / 2.0,
        Align::Right => -width(text),
    };
    let middle = font::ASCENT as f64 / 2.0;
    let mut strokes = Vec::new();
    for character in text.chars() {
        let (first, wide) = columns(character);
        let top = font::descent(character) as f64 + 0.5 - middle;
        let place = |[x, y]: [i32; 2]| [left - first + f64::from(x) + 0.5, top + f64::from(y)];
        strokes.extend(joined(&font::glyph(character)).map(|[a, b]| [place(a), place(b)]));
        left += wide + GAP;
    }
    strokes
}

/// First column of a character and how many it takes. Digits are all as wide, so that numbers stand below each other.
fn columns(character: char) -> (f64, f64) {
    let used = font::glyph(character).into_iter().fold(0, |used, row| used | row);
    if character.is_ascii_digit() {
        return (0.0, 5.0);
    }
    if used == 0 {
        return (0.0, 3.0);
    }
    // Five columns, the highest of the five bits left.
    let (first, last) = (used.leading_zeros() - 3, 4 - used.trailing_zeros());
    (f64::from(first), f64::from(last + 1 - first))
}

/// Pairs of dots that touch: side by side, or by their corners where no dot beside them makes that bend already.
/// A dot without neighbours is joined to itself.
fn joined(glyph: &[u8; 7]) -> impl Iterator<Item = [[i32; 2]; 2]> {
    let set = |[x, y]: [i32; 2]| {
        (0..5).contains(&x)
            && usize::try_from(y).ok().and_then(|y| glyph.get(y)).is_some_and(|row| row & (0b10000 >> x) != 0)
    };
    let dots = (0..7).flat_map(|y| (0..5).map(move |x| [x, y])).filter(|dot| set(*dot));
    let mut pairs = Vec::new();
    for [x, y] in dots {
        pairs.push([[x, y], [x, y]]);
        for step in [[1, 0], [0, 1], [1, 1], [-1, 1]] {
            let other = [x + step[0], y + step[1]];
            let corner = step[0] != 0 && step[1] != 0;
            let bent = corner && (set([other[0], y]) || set([x, other[1]]));
            if set(other) && !bent {
                pairs.push([[x, y], other]);
            }
        }
    }
    pairs.into_iter()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_minus_is_one_stroke_and_an_l_bends_without_a_short_cut() {
        let lines = |character| joined(&font::glyph(character)).filter(|[a, b]| a != b).collect::<Vec<_>>();
        assert_eq!(lines('-').len(), 3);
        assert!(lines('L').iter().all(|[a, b]| a[0] == b[0] || a[1] == b[1]));
        assert!(lines('/').iter().all(|[a, b]| a[0] != b[0] && a[1] != b[1]));
    }

    #[test]
    fn a_right_aligned_text_ends_at_its_anchor() {
        let right = strokes("12.5", Align::Right).iter().flatten().map(|p| p[0]).fold(f64::MIN, f64::max);
        assert_eq!(right, -0.5);
    }

    #[test]
    fn narrow_letters_take_less_room_and_digits_all_the_same() {
        assert!(width("ill") < width("wow"));
        assert_eq!(width("1111"), width("8888"));
        assert_eq!((columns('l'), columns('('), columns('x')), ((1.0, 3.0), (1.0, 3.0), (0.0, 5.0)));
    }
}
