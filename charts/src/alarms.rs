//! The trade-off of a detector: false alarms an hour against its delay.

use super::chart::{Chart, Series};
use super::sheet::Sheet;

/// A setting of a detector, tried for some hours.
#[derive(Clone, Debug)]
pub struct Alarm {
    /// The setting, such as `TSTOP=200`.
    pub setting: String,
    /// Its delay, ms.
    pub delay_ms: f64,
    /// False alarms.
    pub alarms: u64,
    /// Hours in which they came.
    pub hours: f64,
}

/// With 95 % confidence no more come in the time in which none came: −ln 0.05.
const NONE_SEEN: f64 = 3.0;

impl Alarm {
    /// False alarms an hour; if none came, the bound of 95 %.
    fn an_hour(&self) -> f64 {
        if self.alarms > 0 { self.alarms as f64 / self.hours } else { NONE_SEEN / self.hours }
    }
}

/// A chart with a curve for each detector and its name; up to eight.
pub fn trade_off(sheet: &mut Sheet, title: &str, curves: &[(String, Vec<Alarm>)]) {
    let mut chart = Chart::new(title, "false alarms / h", "delay in ms");
    (chart.height, chart.log) = (320.0, true);
    for ((name, alarms), number) in curves.iter().zip(1..=8) {
        let mut alarms = alarms.clone();
        alarms.sort_by(|a, b| a.delay_ms.total_cmp(&b.delay_ms));
        let mut columns = |keep: &dyn Fn(&Alarm) -> bool| {
            let kept: Vec<&Alarm> = alarms.iter().filter(|alarm| keep(alarm)).collect();
            let x = sheet.column(kept.iter().map(|alarm| alarm.delay_ms).collect(), None);
            let y = sheet.column(kept.iter().map(|alarm| alarm.an_hour()).collect(), None);
            (x, y, kept.iter().map(|alarm| alarm.setting.clone()).collect::<Vec<String>>())
        };
        let class = format!("c{number}");
        let (x, y, _) = columns(&|_| true);
        let key = Some(name.clone());
        chart.series.push(Series { key: key.clone(), ..Series::line(name, &format!("{class} thin"), x, y) });
        let (x, y, settings) = columns(&|alarm| alarm.alarms > 0);
        if !settings.is_empty() {
            let series = Series::points(&format!("{name}, seen"), &class, x, y, settings);
            chart.series.push(Series { key: key.clone(), ..series });
        }
        let (x, y, settings) = columns(&|alarm| alarm.alarms == 0);
        if !settings.is_empty() {
            let name = format!("{name}, none seen: fewer than this (95 %)");
            let series = Series::points(&name, &format!("{class} hollow"), x, y, settings);
            chart.series.push(Series { key, ..series });
        }
    }
    sheet.chart(&chart);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_alarm_is_drawn_at_its_bound() {
        let alarm = |alarms| Alarm { setting: "TSTOP=200".to_owned(), delay_ms: 200.0, alarms, hours: 6.0 };
        assert_eq!((alarm(3).an_hour(), alarm(0).an_hour()), (0.5, 0.5));
        let mut sheet = Sheet::new("x");
        trade_off(&mut sheet, "Stall", &[("TSTOP".to_owned(), vec![alarm(3), alarm(0)])]);
        let page = sheet.finish();
        assert!(page.contains("TSTOP, seen") && page.contains("none seen"), "both kinds of points");
    }
}
