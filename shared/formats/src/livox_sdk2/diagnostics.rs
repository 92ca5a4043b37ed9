//! What a device thinks of itself.

/// The value of [`super::key::DIAGNOSTICS`]: four fields of 4 bits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Diagnostics(pub u16);

const WORDS: [[&str; 3]; 4] = [
    ["system warning", "system error", "system safety error"],
    ["scanner warning", "scanner error", "scanner safety error"],
    ["ranging warning", "ranging error", "ranging safety error"],
    ["communication warning", "communication error", "communication safety error"],
];

impl Diagnostics {
    /// All four fields by name, in words.
    pub fn flags(self) -> [(&'static str, &'static str); 4] {
        let names = ["system", "scanner", "ranging", "communication"];
        [0, 1, 2, 3].map(|field| {
            let level = ["ok", "warning", "error", "safety error"].get(self.level(field)).copied();
            (names[field], level.unwrap_or("unknown"))
        })
    }

    /// The worst that it complains of; `None` where all is well.
    pub fn complaint(self) -> Option<&'static str> {
        let worst = (0..4).max_by_key(|field| self.level(*field))?;
        let level = self.level(worst).checked_sub(1)?;
        WORDS.get(worst)?.get(level.min(2)).copied()
    }

    fn level(self, field: usize) -> usize {
        usize::from(self.0 >> (4 * field) & 0xf)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_worst_field_is_the_complaint_and_all_are_named() {
        assert_eq!(Diagnostics(0).complaint(), None);
        assert_eq!(Diagnostics(0x1021).complaint(), Some("scanner error"));
        assert_eq!(Diagnostics(0xf000).complaint(), Some("communication safety error"));
        let flags = Diagnostics(0x1f20).flags();
        assert_eq!(flags.map(|(_, word)| word), ["ok", "error", "unknown", "warning"]);
    }
}
