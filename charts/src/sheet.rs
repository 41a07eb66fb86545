//! A self-contained page of text, tables and charts: one HTML file with style, script and numbers inside, which opens from disk.

use std::fmt::Write;

use super::chart::{Chart, Column, Drawing, Numbers, escape, range_across};

/// Light or dark as the reader's system is. Blue, vermilion and green, which come first, are distinct for color-blind readers.
const STYLE: &str = include_str!("style.css");
const SCRIPT: &str = concat!(include_str!("axis.js"), include_str!("report.js"));

/// A page under construction.
pub struct Sheet {
    title: String,
    body: String,
    columns: Vec<Numbers>,
    /// Each with its place in the body.
    charts: Vec<(usize, Chart)>,
}

impl Sheet {
    /// An empty page. `title` is plain text, that of the window.
    #[must_use]
    pub fn new(title: &str) -> Self {
        Self { title: title.to_owned(), body: String::new(), columns: Vec::new(), charts: Vec::new() }
    }

    /// Keeps numbers for charts, with `digits` after the point, or as many as they need. What is not finite is absent.
    pub fn column(&mut self, values: Vec<f64>, digits: Option<usize>) -> Column {
        self.columns.push(Numbers { digits, values });
        Column(self.columns.len() - 1)
    }

    /// Appends HTML; [`escape`] what is text.
    pub fn push(&mut self, html: &str) {
        self.body.push_str(html);
    }

    /// Appends a table: `head` and cells are plain text, and columns from `numbers` on are numbers.
    pub fn table(&mut self, head: &[&str], rows: &[Vec<String>], numbers: usize) {
        let class = |at: usize| if at >= numbers { " class=\"n\"" } else { "" };
        self.body.push_str("<div class=\"table\"><table>\n<tr>");
        for (at, cell) in head.iter().enumerate() {
            let _ = write!(self.body, "<th{}>{}</th>", class(at), escape(cell));
        }
        self.body.push_str("</tr>\n");
        for row in rows {
            self.body.push_str("<tr>");
            for (at, cell) in row.iter().enumerate() {
                let _ = write!(self.body, "<td{}>{}</td>", class(at), escape(cell));
            }
            self.body.push_str("</tr>\n");
        }
        self.body.push_str("</table></div>\n");
    }

    /// Appends a chart.
    pub fn chart(&mut self, chart: &Chart) {
        self.charts.push((self.body.len(), chart.clone()));
    }

    /// The body with its charts, which share axes with later ones.
    fn drawn(&self) -> String {
        let (mut drawn, mut begin) = (String::new(), 0);
        for (number, (end, chart)) in self.charts.iter().enumerate() {
            let shares = |other: &Chart| chart.x.group.is_some() && chart.x == other.x;
            let group = self.charts.iter().enumerate();
            let group =
                group.filter(|(at, (_, other))| *at == number || shares(other)).map(|(_, (_, other))| other);
            let across = range_across(group, &self.columns);
            let svg = Drawing { chart, columns: &self.columns, across }.svg();
            drawn.push_str(&self.body[begin..*end]);
            let _ =
                writeln!(drawn, "<figure data-chart=\"{number}\"><div class=\"pane\">{svg}</div></figure>");
            begin = *end;
        }
        drawn + &self.body[begin..]
    }

    /// Appends how charts are used, for readers with scripts.
    pub fn help(&mut self) {
        self.push(
            "<p class=\"help\">Drag across a chart to zoom, double-click for the whole range; Ctrl and wheel, or the wheel on a \
             clicked chart, zoom at the pointer, two fingers on a touch screen; Shift and drag moves. A click on a curve's name \
             hides it. Arrow keys move the cursor of a chart.</p>\n",
        );
    }

    /// The page.
    #[must_use]
    pub fn finish(self) -> String {
        let mut numbers = String::new();
        for (index, column) in self.columns.iter().enumerate() {
            numbers.push_str(if index > 0 { ",\n" } else { "" });
            column.push(&mut numbers);
        }
        // Texts, numbers and lists only: serialization cannot fail.
        let charts = self.charts.iter().map(|(_, chart)| serde_json::to_string(chart).unwrap_or_default());
        let charts = charts.collect::<Vec<_>>().join(",\n");
        // A text could end the element that contains it.
        let data = format!("{{\"columns\":[{numbers}],\n\"charts\":[{charts}]}}");
        let data = data.replace("</", "<\\/").replace("<!--", "<\\u0021--");
        let script = if self.charts.is_empty() {
            String::new()
        } else {
            format!(
                "<script type=\"application/json\" id=\"data\">{data}</script>\n<script>\n{SCRIPT}</script>\n"
            )
        };
        format!(
            "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
             <title>{} · hil-sim</title>\n<style>\n{STYLE}</style>\n</head>\n<body>\n<main>\n{}</main>\n{script}</body>\n</html>\n",
            escape(&self.title),
            self.drawn()
        )
    }
}

#[cfg(test)]
mod tests {
    use super::super::chart::Series;
    use super::*;

    fn page() -> String {
        let mut sheet = Sheet::new("a </script> & b");
        let times = sheet.column(vec![0.0, 1.0, 2.0], Some(0));
        let values = sheet.column(vec![0.1234, f64::NAN, -0.00001], Some(3));
        let mut chart = Chart::new("</script><!-- x", "V", "ms");
        chart.series.push(Series::line("bus", "c1", times, values));
        sheet.chart(&chart);
        sheet.finish()
    }

    fn data(page: &str) -> serde_json::Value {
        let (_, data) = page.split_once("id=\"data\">").expect("numbers");
        let (data, _) = data.split_once("</script>").expect("an end");
        serde_json::from_str(data).expect("JSON")
    }

    #[test]
    fn numbers_keep_their_digits_and_absent_ones_are_null() {
        let data = data(&page());
        assert_eq!(data["columns"][0], serde_json::json!({ "digits": 0, "values": [0, 1, 2] }));
        assert_eq!(data["columns"][1], serde_json::json!({ "digits": 3, "values": [0.123, null, 0] }));
        assert_eq!(data["charts"][0]["series"][0]["y"], 1);
    }

    #[test]
    fn text_cannot_end_the_element_that_contains_it() {
        let page = page();
        assert_eq!(data(&page)["charts"][0]["title"], "</script><!-- x");
        // The numbers' and the script's own.
        assert_eq!((page.matches("</script>").count(), page.matches("<!--").count()), (2, 0));
    }

    #[test]
    fn charts_of_a_group_share_their_range_across() {
        let mut sheet = Sheet::new("x");
        let time = Some("time");
        let charts = [
            ("ms", time, 20.0),
            ("ms", None, 20.0),
            ("Hz", time, 20.0),
            ("ms", time, 3000.0),
            ("ms", None, 3000.0),
        ];
        for (unit, group, last) in charts {
            let column = sheet.column(vec![0.0, last], None);
            let mut chart = Chart::new("x", "V", unit);
            chart.x.group = group.map(str::to_owned);
            chart.series.push(Series::line("x", "c1", column, column));
            sheet.chart(&chart);
        }
        let page = sheet.finish();
        let pictures: Vec<&str> = page.split("<figure").skip(1).collect();
        let has = |label: &str| pictures.iter().map(|picture| picture.contains(label)).collect::<Vec<_>>();
        assert_eq!(has("\">1500</text>"), [true, false, false, true, true]);
    }

    #[test]
    fn page_loads_nothing() {
        let page = page();
        for word in ["http://", "https://", "src=", "<link", "@import", "url("] {
            // Clips are referred to inside the page.
            let found = page.matches(word).count();
            let expected = if word == "url(" { page.matches("url(#").count() } else { 0 };
            assert_eq!(found, expected, "{word}");
        }
    }
}
