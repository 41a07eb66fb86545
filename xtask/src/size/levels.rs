//! Interrupt priorities of the application, from its source.

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Task {
    pub binds: String,
    /// Higher preempts lower.
    pub priority: u32,
}

/// Tasks of an RTIC source: `#[task(binds = TIM3, priority = 3, ...)]`.
///
/// # Errors
/// No task, or an incomplete attribute, with its line.
pub fn tasks(source: &str) -> Result<Vec<Task>, String> {
    let mut tasks = Vec::new();
    for (number, line) in (1..).zip(source.lines()) {
        let Some(attribute) = line.trim_start().strip_prefix("#[task(") else { continue };
        let value = |key: &str| {
            let (_, rest) = attribute.split_once(key)?;
            let rest = rest.trim_start().strip_prefix('=')?.trim_start();
            Some(&rest[..rest.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(rest.len())])
        };
        match (value("binds"), value("priority").and_then(|text| text.parse().ok())) {
            (Some(binds), Some(priority)) => tasks.push(Task { binds: binds.into(), priority }),
            _ => {
                return Err(format!(
                    "line {number}: found `{}`, expected `binds = INTERRUPT, priority = NUMBER` in this line",
                    line.trim()
                ));
            }
        }
    }
    if tasks.is_empty() {
        Err("found no #[task(binds = ..., priority = ...)], expected some".into())
    } else {
        Ok(tasks)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tasks_are_read_from_their_attributes() {
        let source = "#[rtic::app(device = x)]\n    #[task(binds = TIM4, priority = 5, shared = [tater])]\n    fn hall() {}\n\
                      #[task(priority=1, binds=SysTick)]\n// #[task(binds = NO, priority = 9)]\n";
        let task = |binds: &str, priority| Task { binds: binds.into(), priority };
        assert_eq!(tasks(source), Ok(vec![task("TIM4", 5), task("SysTick", 1)]));
    }

    #[test]
    fn incomplete_task_is_an_error_with_its_line() {
        let error = tasks("fn x() {}\n#[task(binds = TIM4)]").unwrap_err();
        assert!(error.starts_with("line 2: found `#[task(binds = TIM4)]`"), "{error}");
        assert!(tasks("#[task(binds = TIM4, priority = high)]").is_err());
        assert!(tasks("#[task(\n").is_err());
        assert!(tasks("fn main() {}").unwrap_err().starts_with("found no #[task"));
    }

    #[test]
    fn application_source_has_all_levels() {
        let path = crate::program::root().join("boards/tater-f103/src/app.rs");
        let tasks = tasks(&std::fs::read_to_string(path).unwrap()).unwrap();
        let levels: std::collections::BTreeSet<u32> = tasks.iter().map(|task| task.priority).collect();
        assert_eq!(levels.into_iter().collect::<Vec<_>>(), [1, 2, 3, 4, 5]);
    }
}
