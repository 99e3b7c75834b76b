//! Figures drawn as SVG, and as PNG from that.

use crate::error::{PlotError, refused};
use crate::figure::{Axis, Curve, Figure, Panel, Trace};
use crate::paper::Paper;
use crate::scale::Scaled;
use plotters::chart::{ChartBuilder, ChartContext};
use plotters::coord::cartesian::Cartesian2d;
use plotters::drawing::{DrawingArea, IntoDrawingArea};
use plotters::element::{Circle, PathElement, Polygon, Rectangle, Text};
use plotters::series::{DashedLineSeries, LineSeries};
use plotters::style::{Color as _, RGBColor, ShapeStyle, WHITE};

/// The family of the bundled font; a reader of the SVG without it takes any sans-serif.
const FONT: &str = "DejaVu Sans, sans-serif";
/// Height of the title, pixels.
const TITLE: f64 = 21.0;
/// Height of other text, pixels.
const TEXT: f64 = 16.0;
/// Colours that stay apart for the colour-blind (M. Okabe and K. Ito, 2008), black last.
const COLOURS: [RGBColor; 7] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(0, 0, 0),
];

impl Figure {
    /// The figure as SVG text.
    ///
    /// # Errors
    /// [`PlotError::Size`] for a figure without panels or area, [`PlotError::Empty`] when an axis has nothing to show.
    pub fn svg(&self) -> Result<String, PlotError> {
        let Figure { width, height, .. } = *self;
        if self.panels.is_empty() || width < 100 || height < 100 {
            return Err(PlotError::Size { width, height, panels: self.panels.len() });
        }
        let scales = self
            .panels
            .iter()
            .enumerate()
            .map(|(i, panel)| {
                let values = |axis: fn(&(f64, f64)) -> f64| -> Vec<f64> {
                    panel.traces.iter().flat_map(|s| s.curve.points()).map(|point| axis(&point)).collect()
                };
                let of = |axis: &Axis, values: Vec<f64>, name| {
                    Scaled::new(axis.spacing, axis.range, &values).ok_or(PlotError::Empty { panel: i + 1, axis: name })
                };
                Ok((of(&panel.x, values(|p| p.0), "x")?, of(&panel.y, values(|p| p.1), "y")?))
            })
            .collect::<Result<Vec<_>, PlotError>>()?;
        let mut text = String::new();
        {
            let root = Paper::new(&mut text, (width, height)).into_drawing_area();
            root.fill(&WHITE).map_err(refused)?;
            // An empty title takes no room.
            let below = if self.title.is_empty() {
                root.clone()
            } else {
                root.titled(&self.title, (FONT, TITLE)).map_err(refused)?
            };
            for ((area, panel), scale) in
                below.split_evenly((self.panels.len(), 1)).iter().zip(&self.panels).zip(scales)
            {
                draw(area, panel, scale).map_err(refused)?;
            }
            root.present().map_err(refused)?;
        }
        Ok(text)
    }

    /// The figure as a PNG file, `zoom` pixels per pixel of the SVG.
    ///
    /// # Errors
    /// [`PlotError::NoPng`] without the feature `png`, which brings a font and a renderer; otherwise as for [`svg`](Self::svg).
    pub fn png(&self, zoom: f32) -> Result<Vec<u8>, PlotError> {
        #[cfg(feature = "png")]
        return crate::png::pixels(self, zoom);
        #[cfg(not(feature = "png"))]
        {
            let _ = zoom;
            Err(PlotError::NoPng)
        }
    }
}

type Area<'a> = DrawingArea<Paper<'a>, plotters::coord::Shift>;
type Chart<'a, 'b> = ChartContext<'a, Paper<'b>, Cartesian2d<Scaled, Scaled>>;
type Drawn = Result<(), plotters::drawing::DrawingAreaErrorKind<std::io::Error>>;

/// Number of points of a curve below which each is drawn larger.
const FEW: usize = 60;
/// Width of a legend's symbol, pixels.
const SYMBOL: i32 = 26;
/// Height of a legend's line, pixels.
const LINE: i32 = 24;
/// Width of the axes' labels left of the curves, with the margin.
const LEFT: i32 = 96;
/// Upper estimate of the mean width of a letter, as a share of the text's height.
const LETTER: f64 = 0.62;

/// Layout of the legend: for every named trace x (pixels), its line and the trace.
fn places(panel: &Panel, width: i32) -> Vec<(i32, i32, &Trace)> {
    let (mut x, mut line) = (LEFT, 0);
    let mut found = Vec::new();
    for trace in panel.traces.iter().filter(|trace| !trace.name.is_empty()) {
        let wide = SYMBOL + 34 + (LETTER * TEXT * trace.name.chars().count() as f64) as i32;
        if x > LEFT && x + wide > width {
            (x, line) = (LEFT, line + 1);
        }
        found.push((x, line, trace));
        x += wide;
    }
    found
}

fn draw(area: &Area<'_>, panel: &Panel, (x, y): (Scaled, Scaled)) -> Drawn {
    let legend = places(panel, area.dim_in_pixel().0 as i32);
    // The legend stands above the curves, where it hides none of them.
    let lines = legend.last().map_or(0, |(_, line, _)| line + 1);
    let mut chart = ChartBuilder::on(area)
        .margin(12)
        .margin_top(12 + LINE * lines)
        .margin_right(24)
        .x_label_area_size(52)
        .y_label_area_size(84)
        .build_cartesian_2d(x, y)?;
    chart
        .configure_mesh()
        .x_desc(panel.x.label.as_str())
        .y_desc(panel.y.label.as_str())
        .axis_desc_style((FONT, TEXT))
        .label_style((FONT, TEXT))
        .bold_line_style(RGBColor(200, 200, 200))
        .light_line_style(RGBColor(232, 232, 232))
        .x_labels(((area.dim_in_pixel().0 / 80) as usize).max(3))
        .y_labels(((area.dim_in_pixel().1 / 38) as usize).clamp(3, 10))
        .draw()?;
    for trace in &panel.traces {
        draw_trace(&mut chart, trace)?;
    }
    for (x, line, trace) in legend {
        draw_name(area, trace, (x, 6 + LINE * line + LINE / 2))?;
    }
    Ok(())
}

/// Symbol and name of a trace; `y` is the middle of the line.
fn draw_name(area: &Area<'_>, trace: &Trace, (x, y): (i32, i32)) -> Drawn {
    let colour = COLOURS[trace.colour % COLOURS.len()];
    let thick = ShapeStyle::from(&colour).stroke_width(2);
    match &trace.curve {
        Curve::Line(_) => area.draw(&PathElement::new(vec![(x, y), (x + SYMBOL, y)], thick))?,
        Curve::Dashed(_) => {
            area.draw(&PathElement::new(vec![(x, y), (x + 10, y)], thick))?;
            area.draw(&PathElement::new(vec![(x + 16, y), (x + SYMBOL, y)], thick))?;
        }
        Curve::Points(_) => area.draw(&Circle::new((x + SYMBOL / 2, y), 3, colour.filled()))?,
        Curve::Band(_) => {
            area.draw(&Rectangle::new([(x, y - 6), (x + SYMBOL, y + 6)], colour.mix(0.22).filled()))?;
        }
    }
    area.draw(&Text::new(trace.name.as_str(), (x + SYMBOL + 8, y - TEXT as i32 / 2), (FONT, TEXT)))
}

fn draw_trace<'a, 'b: 'a>(chart: &mut Chart<'a, 'b>, trace: &Trace) -> Drawn {
    let colour = COLOURS[trace.colour % COLOURS.len()];
    let thick = ShapeStyle::from(&colour).stroke_width(2);
    let (x, y) = (chart.as_coord_spec().x_spec().clone(), chart.as_coord_spec().y_spec().clone());
    let shown = |points: &[(f64, f64)]| -> Vec<Vec<(f64, f64)>> {
        points
            .split(|&(a, b)| !(x.can_show(a) && y.can_show(b)))
            .filter(|run| !run.is_empty())
            .map(<[_]>::to_vec)
            .collect()
    };
    match &trace.curve {
        Curve::Line(points) => {
            for run in shown(points) {
                chart.draw_series(LineSeries::new(run, thick))?;
            }
        }
        Curve::Dashed(points) => {
            for run in shown(points) {
                chart.draw_series(DashedLineSeries::new(run, 9, 6, thick))?;
            }
        }
        Curve::Points(points) => {
            let radius = if points.len() < FEW { 4 } else { 2 };
            chart
                .draw_series(shown(points).into_iter().flatten().map(|at| Circle::new(at, radius, colour.filled())))?;
        }
        Curve::Band(band) => {
            let style = colour.mix(0.22).filled();
            let runs = band.split(|&(a, low, high)| !(x.can_show(a) && y.can_show(low) && y.can_show(high)));
            let areas = runs.filter(|run| run.len() > 1).map(|run| {
                let there = run.iter().map(|&(a, low, _)| (a, low));
                let back = run.iter().rev().map(|&(a, _, high)| (a, high));
                Polygon::new(there.chain(back).collect::<Vec<_>>(), style)
            });
            chart.draw_series(areas)?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::PlotError;
    use crate::figure::{Axis, Curve, Figure, Panel, Trace};

    fn figure() -> Figure {
        let wave: Vec<(f64, f64)> = (1..200).map(|i| (f64::from(i) * 0.1, (f64::from(i) * 0.1).sin())).collect();
        let band = wave.iter().map(|&(x, y)| (x, y - 0.1, y + 0.1)).collect();
        let mut holed = wave.clone();
        holed[50].1 = f64::NAN;
        Figure::new(
            "A wave & its <band>",
            vec![Panel {
                x: Axis::logarithmic("Frequency [Hz]"),
                y: Axis::linear("Height [m]"),
                traces: vec![
                    Trace::new("band", 0, Curve::Band(band)),
                    Trace::new("wave", 0, Curve::Line(holed)),
                    Trace::new("dashed", 1, Curve::Dashed(wave.clone())),
                    Trace::new("points", 2, Curve::Points(wave)),
                ],
            }],
        )
    }

    #[test]
    fn a_figure_is_drawn_as_text_and_as_pixels() {
        let figure = figure();
        let svg = figure.svg().expect("drawable");
        assert_eq!(svg, figure.svg().expect("drawable"), "deterministic");
        assert!(svg.starts_with("<svg") && svg.trim_end().ends_with("</svg>"));
        // The line with a hole is two lines; names are escaped.
        assert!(svg.contains("Frequency [Hz]") && svg.contains("&lt;band&gt;") && !svg.contains("NaN"));
        let png = figure.png(1.0).expect("drawable");
        assert_eq!(&png[1..4], b"PNG");
        let (width, height) =
            (u32::from_be_bytes([0, 0, png[18], png[19]]), u32::from_be_bytes([0, 0, png[22], png[23]]));
        assert_eq!((width, height), (figure.width, figure.height));
    }

    #[test]
    fn nothing_to_draw_is_an_error() {
        let mut empty = figure();
        empty.panels[0].traces = vec![Trace::new("", 0, Curve::Line(vec![(-1.0, 2.0), (f64::NAN, 3.0)]))];
        assert_eq!(empty.svg(), Err(PlotError::Empty { panel: 1, axis: "x" }));
        empty.panels.clear();
        assert!(matches!(empty.svg(), Err(PlotError::Size { panels: 0, .. })));
    }
}
