//! Lines, discs and texts on a picture.

use evac_formats::rgb_image::RgbImage;

use crate::font;

/// Red, green, blue.
pub type Colour = [u8; 3];

/// Pixels `left..right` and `top..bottom`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Frame {
    /// First column inside.
    pub left: i64,
    /// First row inside.
    pub top: i64,
    /// First column to the right of it.
    pub right: i64,
    /// First row below it.
    pub bottom: i64,
}

impl Frame {
    /// Whether a pixel is inside.
    pub fn contains(&self, x: i64, y: i64) -> bool {
        (self.left..self.right).contains(&x) && (self.top..self.bottom).contains(&y)
    }

    /// Columns.
    pub fn width(&self) -> i64 {
        self.right - self.left
    }

    /// Rows.
    pub fn height(&self) -> i64 {
        self.bottom - self.top
    }
}

/// A picture with a frame outside of which nothing is drawn.
pub struct Canvas {
    image: RgbImage,
    clip: Frame,
}

impl Canvas {
    /// A picture of one colour.
    pub fn new(width: u32, height: u32, colour: Colour) -> Self {
        let clip = Frame { left: 0, top: 0, right: i64::from(width), bottom: i64::from(height) };
        Self { image: RgbImage::new(width, height, colour), clip }
    }

    /// The finished picture.
    pub fn into_image(self) -> RgbImage {
        self.image
    }

    /// Draws inside `frame` only, until [`Self::unclip`].
    pub fn clip(&mut self, frame: Frame) {
        self.clip = frame;
    }

    /// Draws everywhere again.
    pub fn unclip(&mut self) {
        let (width, height) = (self.image.width(), self.image.height());
        self.clip = Frame { left: 0, top: 0, right: i64::from(width), bottom: i64::from(height) };
    }

    /// Colours a pixel; one outside the frame is left out.
    pub fn pixel(&mut self, x: i64, y: i64, colour: Colour) {
        if self.clip.contains(x, y) {
            self.image.set(x, y, colour);
        }
    }

    /// Colours all pixels of a frame.
    pub fn fill(&mut self, frame: Frame, colour: Colour) {
        for (x, y) in (frame.top..frame.bottom).flat_map(|y| (frame.left..frame.right).map(move |x| (x, y))) {
            self.pixel(x, y, colour);
        }
    }

    /// The border of a frame, `width` pixels outside of it.
    pub fn outline(&mut self, frame: Frame, width: i64, colour: Colour) {
        let Frame { left, top, right, bottom } = frame;
        let (wide, tall) = ((left - width, right + width), (top - width, bottom + width));
        for (from, to) in [(top - width, top), (bottom, bottom + width)] {
            self.fill(Frame { left: wide.0, top: from, right: wide.1, bottom: to }, colour);
        }
        for (from, to) in [(left - width, left), (right, right + width)] {
            self.fill(Frame { left: from, top: tall.0, right: to, bottom: tall.1 }, colour);
        }
    }

    /// A filled disc of a radius in pixels.
    pub fn disc(&mut self, [x, y]: [f64; 2], radius: f64, colour: Colour) {
        let reach = radius.ceil() as i64;
        let (cx, cy) = (x.floor() as i64, y.floor() as i64);
        for (px, py) in
            (cy - reach..=cy + reach).flat_map(|py| (cx - reach..=cx + reach).map(move |px| (px, py)))
        {
            let (dx, dy) = (px as f64 + 0.5 - x, py as f64 + 0.5 - y);
            if dx * dx + dy * dy <= radius * radius {
                self.pixel(px, py, colour);
            }
        }
    }

    /// A line with round ends.
    pub fn line(&mut self, a: [f64; 2], b: [f64; 2], width: f64, colour: Colour) {
        let (dx, dy) = (b[0] - a[0], b[1] - a[1]);
        let steps = (dx.hypot(dy) * 2.0).ceil().max(1.0);
        for i in 0..=steps as u32 {
            let share = f64::from(i) / steps;
            self.disc([a[0] + dx * share, a[1] + dy * share], width / 2.0, colour);
        }
    }

    /// An arrow head with its tip at `tip`, pointing along the unit vector `along`.
    pub fn arrow_head(&mut self, tip: [f64; 2], along: [f64; 2], size: f64, colour: Colour) {
        let rows = (size * 2.0).ceil().max(1.0);
        for i in 0..=rows as u32 {
            let back = size * f64::from(i) / rows;
            let half = back * 0.55;
            let centre = [tip[0] - along[0] * back, tip[1] - along[1] * back];
            let side = [-along[1] * half, along[0] * half];
            let ends =
                [[centre[0] - side[0], centre[1] - side[1]], [centre[0] + side[0], centre[1] + side[1]]];
            self.line(ends[0], ends[1], 1.5, colour);
        }
    }

    /// A text with its upper left corner at `x, y`, each dot `scale` pixels wide.
    pub fn text(&mut self, x: i64, y: i64, scale: i64, colour: Colour, text: &str) {
        let mut left = x;
        for character in text.chars() {
            let top = y + font::descent(character) * scale;
            for (row, bits) in (0..).zip(font::glyph(character)) {
                for column in (0..5).filter(|column| bits & (0b10000 >> column) != 0) {
                    let (left, top) = (left + column * scale, top + row * scale);
                    self.fill(Frame { left, top, right: left + scale, bottom: top + scale }, colour);
                }
            }
            left += font::ADVANCE * scale;
        }
    }
}

/// Width of a text in pixels.
pub fn text_width(text: &str, scale: i64) -> i64 {
    let characters = text.chars().count() as i64;
    (characters * font::ADVANCE - 1).max(0) * scale
}

/// Height of a line of text in pixels, without what hangs below it.
pub fn text_height(scale: i64) -> i64 {
    font::ASCENT * scale
}
