//! Drawings as SVG, written by hand: a plotting crate writes fixed colours, and these follow the reader's light or dark
//! theme through the classes of `figure.css`.

use std::fmt::Write;

/// The classes that drawings use, with their colours in both themes.
pub(super) const STYLE: &str = include_str!("figure.css");

/// A drawing in the making; x to the right, y down, px.
#[derive(Clone, Debug)]
pub(super) struct Svg {
    width: f64,
    height: f64,
    label: String,
    body: String,
}

/// Where a text is held.
#[derive(Clone, Copy, Debug)]
pub(super) enum Anchor {
    Start,
    Middle,
    End,
}

/// A number as SVG has it: two decimals at most.
pub(super) fn n(value: f64) -> String {
    let text = format!("{value:.2}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".to_owned() } else { text.to_owned() }
}

/// Text between tags or in an attribute.
pub(super) fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

impl Svg {
    /// `label` says what it shows, for those who cannot see it.
    pub(super) fn new(width: f64, height: f64, label: &str) -> Self {
        Self { width, height, label: escape(label), body: String::new() }
    }

    pub(super) fn line(&mut self, class: &str, from: [f64; 2], to: [f64; 2]) {
        let ([x1, y1], [x2, y2]) = (from.map(n), to.map(n));
        let _ = writeln!(self.body, r#"<line class="{class}" x1="{x1}" y1="{y1}" x2="{x2}" y2="{y2}"/>"#);
    }

    /// `at`: the upper left corner.
    pub(super) fn rect(&mut self, class: &str, at: [f64; 2], size: [f64; 2], extra: &str) {
        let ([x, y], [w, h]) = (at.map(n), size.map(n));
        let _ = writeln!(self.body, r#"<rect class="{class}" x="{x}" y="{y}" width="{w}" height="{h}"{extra}/>"#);
    }

    pub(super) fn circle(&mut self, class: &str, at: [f64; 2], radius: f64) {
        let ([x, y], r) = (at.map(n), n(radius));
        let _ = writeln!(self.body, r#"<circle class="{class}" cx="{x}" cy="{y}" r="{r}"/>"#);
    }

    /// `commands`: path data.
    pub(super) fn path(&mut self, class: &str, commands: &str) {
        if !commands.is_empty() {
            let _ = writeln!(self.body, r#"<path class="{class}" d="{commands}"/>"#);
        }
    }

    /// `at`: on the baseline.
    pub(super) fn text(&mut self, class: &str, anchor: Anchor, at: [f64; 2], text: &str) {
        let class = match anchor {
            Anchor::Start => class.to_owned(),
            Anchor::Middle => format!("{class} middle"),
            Anchor::End => format!("{class} end"),
        };
        let [x, y] = at.map(n);
        let _ = writeln!(self.body, r#"<text class="{}" x="{x}" y="{y}">{}</text>"#, class.trim(), escape(text));
    }

    /// A text whose parts have classes of their own.
    pub(super) fn parts(&mut self, at: [f64; 2], parts: &[(&str, &str)]) {
        let [x, y] = at.map(n);
        let _ = write!(self.body, r#"<text x="{x}" y="{y}">"#);
        for (class, text) in parts {
            let _ = write!(self.body, r#"<tspan class="{class}">{}</tspan>"#, escape(text));
        }
        self.body.push_str("</text>\n");
    }

    /// As `text`, reading upwards.
    pub(super) fn text_up(&mut self, class: &str, at: [f64; 2], text: &str) {
        let [x, y] = at.map(n);
        let _ = writeln!(
            self.body,
            r#"<text class="{class} middle" transform="translate({x} {y}) rotate(-90)">{}</text>"#,
            escape(text)
        );
    }

    /// What follows until [`Svg::close`] has `attributes`, and says `hint` under the pointer.
    pub(super) fn open(&mut self, attributes: &str, hint: &str) {
        let _ = write!(self.body, "<g{attributes}>");
        if !hint.is_empty() {
            let _ = write!(self.body, "<title>{}</title>", escape(hint));
        }
        self.body.push('\n');
    }

    pub(super) fn close(&mut self) {
        self.body.push_str("</g>\n");
    }

    /// Only the part in this rectangle of what follows until [`Svg::close`] is drawn.
    pub(super) fn clip(&mut self, at: [f64; 2], size: [f64; 2]) {
        // A nested drawing clips by itself, without an id that must be unique on the page.
        let ([x, y], [w, h]) = (at.map(n), size.map(n));
        let _ = writeln!(self.body, r#"<svg x="{x}" y="{y}" width="{w}" height="{h}" viewBox="{x} {y} {w} {h}">"#);
    }

    pub(super) fn close_clip(&mut self) {
        self.body.push_str("</svg>\n");
    }

    /// For a page that has [`STYLE`] already.
    pub(super) fn inline(&self) -> String {
        let Self { label, body, .. } = self;
        let (w, h) = (n(self.width), n(self.height));
        format!(
            "<svg class=\"figure\" width=\"{w}\" viewBox=\"0 0 {w} {h}\" role=\"img\" aria-label=\"{label}\">\n{body}</svg>\n"
        )
    }

    /// As a file of its own.
    pub(super) fn file(&self) -> String {
        let Self { label, body, .. } = self;
        let (w, h) = (n(self.width), n(self.height));
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" class=\"figure\" width=\"{w}\" height=\"{h}\" \
             viewBox=\"0 0 {w} {h}\" role=\"img\" aria-label=\"{label}\">\n<style>\n{STYLE}</style>\n\
             <rect class=\"paper\" width=\"100%\" height=\"100%\"/>\n{body}</svg>\n"
        )
    }
}

/// Path data of a line through points.
pub(super) fn polyline(points: impl IntoIterator<Item = [f64; 2]>) -> String {
    let mut data = String::new();
    for (index, [x, y]) in points.into_iter().enumerate() {
        let _ = write!(data, "{}{} {}", if index == 0 { 'M' } else { 'L' }, n(x), n(y));
    }
    data
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short_and_text_cannot_break_out() {
        assert_eq!([n(1.0), n(-0.001), n(2.345_6), n(100.0)], ["1", "0", "2.35", "100"]);
        let mut svg = Svg::new(10.0, 10.0, "a < \"b\"");
        svg.text("soft", Anchor::Start, [0.0, 0.0], "<script>&");
        assert!(svg.inline().contains("&lt;script&gt;&amp;") && svg.inline().contains("a &lt; &quot;b&quot;"));
    }
}
