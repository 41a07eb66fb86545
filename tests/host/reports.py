"""Opens the reports of hil-sim from disk in a headless Chromium: click, zoom, cursor, colors, paper, telephone.

usage: reports.py HIL-SIM CHROMIUM [FOLDER FOR PICTURES]
"""

import csv
import json
import os
import subprocess
import sys
import tempfile

from browser import Browser

# A kilobyte is 1000 bytes. The pages' own part: style, script, text and static pictures, without the numbers.
MOST_BYTES = 1_000_000

SWEEP = """
scenario = "spread-full-travel"
samples = 20
[grid]
set.KP = [60, 120, 240]
[random]
plant.inertia = { from = "0.7x", to = "1.4x" }
"""

# The module that writes each kind of page, and a page of it below. A kind without one fails the check.
KINDS = {
    "hil-sim/src/page.rs": ["a/report.html"],
    "hil-sim/src/identify.rs": ["ident/residuals.html"],
    "hil-sim/tuning/src/compare.rs": ["compare.html"],
    "hil-sim/tuning/src/sweep/report.rs": ["sweep/report.html"],
    "hil-sim/src/tune_report.rs": ["tune/report.html"],
    "hil-sim/tuning/src/bode/page.rs": ["bode/bode.html"],
}

CHARTS = "[...document.querySelectorAll('figure[data-chart]')]"


def check(holds, what):
    if not holds:
        raise AssertionError(what)


def ticks(browser):
    """The labels of the x axis of every chart."""
    return browser.value(
        f"{CHARTS}.map(f => [...f.querySelectorAll('svg[tabindex] text.tick[text-anchor=middle]')].map(t => t.textContent).join(' '))"
    )


def middle(browser, chart, share=0.5):
    """A place in a chart, in pixels of the window."""
    x, y, width, height = browser.value(
        f"(() => {{ const s = {CHARTS}[{chart}].querySelector('svg[tabindex]'); s.scrollIntoView({{block: 'center'}});"
        " const b = s.getBoundingClientRect(); return [b.x, b.y, b.width, b.height]; })()"
    )
    return x + share * width, y + height / 2


def legend(browser, chart):
    """Names, values and whether they are shown."""
    return browser.value(
        f"[...{CHARTS}[{chart}].querySelectorAll('.legend button')].map(b => [b.querySelector('span:not(.swatch)').textContent,"
        " b.querySelector('output').textContent, b.getAttribute('aria-pressed') === 'true'])"
    )


def curves(browser, chart):
    return browser.value(f"{CHARTS}[{chart}].querySelectorAll('svg[tabindex] g[clip-path] path').length")


def toggle(browser, chart):
    before = curves(browser, chart)
    box = browser.value(
        f"(() => {{ const b = {CHARTS}[{chart}].querySelector('.legend button'); b.scrollIntoView({{block: 'center'}});"
        " const r = b.getBoundingClientRect(); return [r.x + r.width / 2, r.y + r.height / 2]; })()"
    )
    browser.click(*box)
    check(curves(browser, chart) == before - 1, "a click on a name hides its curve")
    check(legend(browser, chart)[0][2] is False, "the name says that it is hidden")
    browser.value(f"{CHARTS}[{chart}].querySelector('.legend button').focus()")
    browser.call("Input.dispatchKeyEvent", type="keyDown", key="Enter", code="Enter", text="\r")
    browser.call("Input.dispatchKeyEvent", type="keyUp", key="Enter", code="Enter")
    check(curves(browser, chart) == before, "the key Enter on the name shows it again")


def zoom(browser):
    whole = ticks(browser)
    check(len(set(whole)) == 1 and whole[0], f"all charts have one time axis: {whole}")
    at = middle(browser, 0)
    browser.click(*at)
    browser.mouse("mouseWheel", *at, deltaX=0, deltaY=-300)
    zoomed = ticks(browser)
    check(len(set(zoomed)) == 1 and zoomed != whole, f"the wheel zooms all charts alike: {zoomed}")
    narrower = [float(text) for text in zoomed[0].split()]
    wider = [float(text) for text in whole[0].split()]
    check(narrower[0] >= wider[0] and narrower[-1] <= wider[-1], "what is shown is a part")
    browser.click(*at, count=2)
    check(ticks(browser) == whole, "a double click shows the whole range")
    browser.mouse("mousePressed", *middle(browser, 0, 0.3), button="left", buttons=1, clickCount=1)
    at = middle(browser, 0, 0.5)
    browser.mouse("mouseMoved", *at, button="left", buttons=1)
    browser.mouse("mouseReleased", *at, button="left", clickCount=1)
    dragged = ticks(browser)
    check(len(set(dragged)) == 1 and dragged != whole, "dragging zooms all charts alike")
    browser.value(f"{CHARTS}[1].querySelector('button.reset').click()")
    check(ticks(browser) == whole, "the button shows the whole range")


def scroll(browser):
    whole = ticks(browser)
    top = browser.value("scrollTo(0, 0), scrollY")
    at = browser.value(f"(() => {{ const b = {CHARTS}[0].getBoundingClientRect(); return [b.x + b.width / 2, b.y + b.height / 2]; }})()")
    browser.mouse("mouseWheel", *at, deltaX=0, deltaY=300)
    # The page scrolls some frames later.
    browser.value("new Promise(done => { const look = () => scrollY > 0 ? done(1) : requestAnimationFrame(look); look(); })")
    check(ticks(browser) == whole and top == 0, "the wheel over a chart that was not clicked scrolls the page")


COLUMNS = {
    "true rotor": {"Position": "position_counts", "Velocity": "velocity_counts_s"},
    "duty": {"Torque and duty": "duty_percent"},
    "phase A": {"Currents": "phase_a_a"},
    "winding": {"Temperature": "winding_c"},
}


def cursor(browser, trace):
    """Values at the cursor are the trace's, digit for digit."""
    rows = {row["time_ms"]: row for row in csv.DictReader(open(trace, encoding="utf-8"))}
    titles = browser.value(f"{CHARTS}.map(f => f.querySelector('.chart-title b').textContent)")
    seen = 0
    for share in [0.2, 0.45, 0.6]:
        browser.mouse("mouseMoved", *middle(browser, 0, share))
        times = browser.value(f"{CHARTS}.map(f => f.querySelector('.at').textContent)")
        check(len(set(times)) == 1 and times[0].endswith(" ms"), f"one cursor in all charts: {times}")
        row = rows[times[0].split()[0]]
        for chart, title in enumerate(titles):
            for name, value, _ in legend(browser, chart):
                column = COLUMNS.get(name, {}).get(title)
                if column:
                    check(float(value) == float(row[column]), f"{title}, {name} at {times[0]}: {value}, {row[column]}")
                    seen += 1
    check(seen >= 12, f"{seen} values were compared")
    browser.value(f"{CHARTS}[0].querySelector('svg[tabindex]').focus()")
    before = browser.value(f"{CHARTS}[1].querySelector('.at').textContent")
    browser.key("ArrowRight")
    after = browser.value(f"{CHARTS}[1].querySelector('.at').textContent")
    check(before != after, "an arrow key moves the cursor")


def colors(browser, path):
    found = []
    for dark in [False, True]:
        browser.open(path, dark=dark)
        found.append(browser.value("[getComputedStyle(document.body).backgroundColor, getComputedStyle(document.querySelector("
                                   "'svg[tabindex] path.c1, svg[tabindex] path.c4')).stroke].join(' ')"))
    check(found[0] != found[1], f"dark has other colors: {found}")


def telephone(browser, path):
    browser.open(path, width=390, height=844, mobile=True)
    width = browser.value("document.documentElement.scrollWidth")
    wide = browser.value("[...document.querySelectorAll('main *')].filter(e => !e.closest('.table, pre, svg, .pane')"
                         " && e.getBoundingClientRect().right > 391).map(e => e.tagName + '.' + e.className).join(' ')")
    check(width <= 390 and not wide, f"nothing is wider than 390 px: {width}, {wide}")
    sizes = browser.value("[...document.querySelectorAll('svg[tabindex] text.tick')].map(t => t.getBoundingClientRect().height)")
    check(min(sizes) >= 10, f"labels are legible: {min(sizes)} px")


def pinch(browser, path):
    """Two fingers that part zoom all charts; one finger moves the cursor."""
    browser.open(path, width=390, height=844, mobile=True)
    browser.call("Emulation.setTouchEmulationEnabled", enabled=True, maxTouchPoints=2)
    whole = ticks(browser)
    x, y = middle(browser, 1)

    def touch(kind, *places):
        points = [{"x": x + dx, "y": y, "id": number} for number, dx in enumerate(places)]
        browser.call("Input.dispatchTouchEvent", type=kind, touchPoints=points)

    touch("touchStart", -40)
    touch("touchMove", -20)
    touch("touchEnd")
    times = browser.value(f"{CHARTS}.map(f => f.querySelector('.at').textContent)")
    check(len(set(times)) == 1 and times[0].endswith(" ms"), f"one finger moves the cursor: {times}")
    touch("touchStart", -20)
    touch("touchStart", -20, 20)
    for by in [30, 40, 60, 80]:
        touch("touchMove", -by, by)
    touch("touchEnd")
    browser.call("Emulation.setTouchEmulationEnabled", enabled=False)
    zoomed = ticks(browser)
    check(len(set(zoomed)) == 1 and zoomed != whole, f"two fingers zoom: {zoomed}")


def overlaps(browser):
    """Pairs of labels of one chart that cover each other."""
    return browser.value(f"""{CHARTS}.flatMap(f => {{
        const all = [...f.querySelectorAll('svg[tabindex] text')].map(t => [t.textContent, t.getBoundingClientRect()]);
        return all.flatMap(([a, p], i) => all.slice(i + 1).filter(([, q]) =>
            p.left < q.right - 1 && q.left < p.right - 1 && p.top < q.bottom - 3 && q.top < p.bottom - 3).map(([b]) => a + ' | ' + b));
    }})""")


def own_bytes(path):
    page = open(path, encoding="utf-8").read()
    begin = page.find('id="data">')
    end = page.find("</script>", begin)
    return len(page.encode()) - len(page[begin:end].encode())


def everywhere(browser, path, pictures):
    """What holds for every page."""
    name = os.path.basename(os.path.dirname(path)) + "-" + os.path.basename(path).removesuffix(".html")
    check(own_bytes(path) <= MOST_BYTES, f"{path}: {own_bytes(path)} bytes beside the numbers")
    colors(browser, path)
    if pictures:
        browser.picture(os.path.join(pictures, f"{name}-dark.png"))
    telephone(browser, path)
    check(not overlaps(browser), f"{path}, on a telephone: labels overlap: {overlaps(browser)[:5]}")
    if pictures:
        browser.picture(os.path.join(pictures, f"{name}-phone.png"))
    browser.open(path)
    check(not overlaps(browser), f"{path}: labels overlap: {overlaps(browser)[:5]}")
    if pictures:
        browser.picture(os.path.join(pictures, f"{name}-light.png"))
    drawn = browser.value(f"{CHARTS}.every(f => f.querySelector('svg[tabindex] g[clip-path] path[d^=M]'))")
    check(drawn, f"{path}: every chart has a curve")
    pdf = browser.printed()
    check(pdf.startswith(b"%PDF") and len(pdf) > 10_000, f"{path} prints")
    if pictures:
        with open(os.path.join(pictures, f"{name}.pdf"), "wb") as file:
            file.write(pdf)


def choose(browser):
    """The axes of a sweep's chart are chosen by select boxes."""
    title = "document.querySelector('figure .chart-title b').textContent"
    before = browser.value(title)
    browser.value("(() => { const s = document.querySelector('select[data-axis=x]'); s.value = 1; s.dispatchEvent(new Event('change')); })()")
    check(browser.value(title) != before, "another axis")
    point = browser.value("""(() => { const svg = document.querySelectorAll('svg[tabindex]')[0]; svg.scrollIntoView({block: 'center'});
        const d = svg.querySelector('path.points').getAttribute('d').slice(1).split('h')[0].split(' ').map(Number);
        const b = svg.getBoundingClientRect(); return [b.x + d[0], b.y + d[1]]; })()""")
    browser.mouse("mouseMoved", *point)
    text = browser.value("document.querySelector('figure .at').textContent")
    check("run " in text and "set.KP=" in text, f"a point names its run: {text!r}")


def spikes(browser, path):
    """Of 20,000 rows in 1,000 pixels the only one with a speed is drawn, and zoomed every row is."""
    browser.open(path)
    path = f"{CHARTS}.find(f => f.textContent.startsWith('Velocity')).querySelector('svg[tabindex] path.c2')"
    height = "document.querySelector('svg[tabindex]').viewBox.baseVal.height"
    points = f"{path}.getAttribute('d').slice(1).split(/[ML]/).map(p => p.split(' ').map(Number))"
    found = browser.value(f"{points}.filter(([, y]) => y < 0.3 * {height}).length")
    check(found == 1, f"the spike is drawn once: {found}")
    browser.value("document.querySelector('svg[tabindex]').focus()")
    for _ in range(30):
        browser.key("+")
    shown = ticks(browser)[0].split()
    rows = browser.value(f"{points}.length")
    span = float(shown[-1]) - float(shown[0])
    check(rows >= span > 0, f"{rows} points for {span} ms")


def no_script(browser, path):
    """Without scripts the static pictures stay."""
    browser.call("Emulation.setScriptExecutionDisabled", value=True)
    browser.open(path)
    found = browser.value("[document.documentElement.classList.contains('live'), document.querySelectorAll('figure svg path.line').length]")
    browser.call("Emulation.setScriptExecutionDisabled", value=False)
    check(found[0] is False and found[1] > 5, f"static charts: {found}")


def rule(browser, path, root):
    """The script's axes have the ranges, ticks and labels that `cargo test -p charts` holds axis.rs to."""
    with open(os.path.join(root, "charts", "axes.json"), encoding="utf-8") as file:
        cases = json.load(file)
    browser.open(path)
    found = browser.value(f"""{json.dumps(cases)}.map(({{ values, log, span, margin, count }}) => {{
        const range = axes.range(values, log, span, margin), axis = axes.axis(...range, 0, 1000, log), ticks = axes.ticks(axis, count);
        return {{ range, ticks, lost: [...ticks.map(([tick]) => tick), ...values.filter(axis.has)].filter(v => !(Math.abs(axis.at(v) - 500) <= 500.1)) }};
    }})""")
    for case, got in zip(cases, found, strict=True):
        for part in ["range", "ticks"]:
            check(got[part] == case[part], f"{case}: the script has the {part} {got[part]}")
        check(not got["lost"], f"{case}: the script has no place for {got['lost']}")


def drawn(browser):
    """Ticks, labels, grid and marks of each chart whose axes nobody chooses: a name, and numbers that are places."""
    return browser.value(f"""{CHARTS}.map(f => f.querySelector('select') ? [] : [...f.querySelectorAll(
        '.pane svg :is(text.tick, text.label, line.grid, line.mark, path.frame)')].filter(e => e.tagName !== 'text' || e.textContent).map(e => [
        `${{e.getAttribute('class')}} ${{e.tagName === 'text' ? e.textContent : ''}}`,
        ['x', 'y', 'x1', 'y1', 'x2', 'y2', 'd'].flatMap(n => (e.getAttribute(n) || '').match(/[-.0-9]+/g) || []).map(Number)]))""")


def alike(browser, path):
    """The static pictures have the axes and marks that the script draws at their width."""
    wide = path.removesuffix(".html") + "-wide.html"
    with open(path, encoding="utf-8") as page, open(wide, "w", encoding="utf-8") as copy:
        # The picture is 1060 wide; so is the script's without paddings and borders.
        copy.write(page.read().replace("main { max-width:1100px;", "main { max-width:1102px;"))
    browser.open(wide)
    live = drawn(browser)
    browser.call("Emulation.setScriptExecutionDisabled", value=True)
    browser.open(wide)
    static = drawn(browser)
    browser.call("Emulation.setScriptExecutionDisabled", value=False)
    os.remove(wide)
    for number, (one, other) in enumerate(zip(live, static, strict=True)):
        if one:
            names = [[name for name, _ in parts] for parts in (one, other)]
            check(names[0] == names[1], f"{path}, chart {number}: the script draws {names[0]}, the picture has {names[1]}")
            for (name, places), (_, others) in zip(one, other):
                # Both round to tenths, halves differently.
                near = len(places) == len(others) and all(abs(a - b) < 0.11 for a, b in zip(places, others))
                check(near, f"{path}, chart {number}, {name}: the script draws at {places}, the picture at {others}")
    return sum(map(len, live))


def hide(browser, path):
    """A chart without a curve still has axes, and no page has a number that is none."""
    lost = "[...document.querySelectorAll('svg, svg *')].flatMap(e => [...e.attributes].map(a => a.value).filter(v => /NaN|Infinity/.test(v)))"
    browser.open(path)
    check(not browser.value(lost), f"{path}: {browser.value(lost)[:5]}")
    browser.value("document.querySelectorAll('.legend button[aria-pressed=true]').forEach(b => b.getAttribute('aria-pressed') === 'true' && b.click())")
    check(browser.value("document.querySelectorAll('svg[tabindex] g[clip-path] path').length") == 0, f"{path}: every curve is hidden")
    check(not browser.value(lost), f"{path}, all curves hidden: {browser.value(lost)[:5]}")
    # The unit of the x axis, and two labels of the y axis.
    bare = browser.value(f"{CHARTS}.filter(f => f.querySelectorAll('svg[tabindex] text.tick[text-anchor=end]').length < 3).map(f => f.textContent)")
    check(not bare, f"{path}, all curves hidden: charts without labels upwards: {bare}")


def kinds(root):
    """The modules that write pages."""
    found = set()
    for folder, _, names in os.walk(os.path.join(root, "hil-sim")):
        for name in names:
            path = os.path.join(folder, name)
            text = open(path, encoding="utf-8").read().split("mod tests")[0]
            if name.endswith(".rs") and "Sheet::new(" in text:
                found.add(os.path.relpath(path, root))
    return found


def published(root):
    """Pages that the documents show."""
    found = []
    for folder, _, names in os.walk(os.path.join(root, "docs")):
        found += [os.path.join(folder, name) for name in sorted(names) if name.endswith(".html")]
    return found


def bounded(browser, path):
    """No axis has more labels than anyone can read: one of millions ends the tab."""
    most = browser.value(f"Math.max(...{CHARTS}.map(f => f.querySelectorAll('svg[tabindex] text.tick').length))")
    check(most <= 200, f"{path}: a chart has {most} labels")


def main(hil_sim, chromium, pictures=None):
    root = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
    check(kinds(root) == set(KINDS), f"a page of each kind is opened: {sorted(kinds(root) ^ set(KINDS))}")
    with tempfile.TemporaryDirectory() as folder, Browser(chromium) as browser:
        def run(*args):
            # 1: an expectation failed, which some of these do.
            done = subprocess.run([os.path.abspath(hil_sim), *args], cwd=folder, capture_output=True, text=True)
            check(done.returncode in (0, 1), f"{args}: {done.stderr}")

        run("run", "spread-full-travel", "--out", "a")
        run("run", "spread-full-travel", "--set", "KP=30", "--out", "b")
        run("run", "link-fast", "--out", "c")
        run("compare", "a", "b", "c", "--out", "compare.html")
        with open(os.path.join(folder, "sweep.toml"), "w", encoding="utf-8") as file:
            file.write(SWEEP)
        run("sweep", "sweep.toml", "--out", "sweep")
        # All objectives: their charts have different axes, of time and of frequency.
        run("tune", "--motor", "link", "--objective", "all", "--robust", "4", "--candidates", "6", "--unseen", "20", "--out", "tune")
        run("excite", "--motor", "tip", "--out", "excited.csv")
        run("identify", "excited.csv", "--motor", "tip", "--out", "ident")
        run("bode", "--motor", "spread", "--mode", "position", "--realizations", "4", "--out", "bode")
        place = lambda name: os.path.join(folder, name)
        rule(browser, place("a/report.html"), root)
        compared = 0
        for name in sorted(sum(KINDS.values(), [])):
            everywhere(browser, place(name), pictures)
            bounded(browser, place(name))
            hide(browser, place(name))
            compared += alike(browser, place(name))
            print(f"{name}: {own_bytes(place(name)) // 1000} kB and {(os.path.getsize(place(name)) - own_bytes(place(name))) // 1000} kB of numbers")
        check(compared > 500, f"{compared} parts of pictures were compared")
        for path in published(root):
            everywhere(browser, path, pictures)
            bounded(browser, path)
            hide(browser, path)
            print(f"{os.path.relpath(path, root)}: {own_bytes(path) // 1000} kB beside the numbers")
        for name in ["a/report.html", "compare.html"]:
            browser.open(place(name))
            zoom(browser)
            toggle(browser, 0)
            browser.open(place(name))
            scroll(browser)
        pinch(browser, place("a/report.html"))
        browser.open(place("a/report.html"))
        cursor(browser, place("a/trace.csv"))
        browser.open(place("sweep/report.html"))
        choose(browser)
        with open(place("spike.csv"), "w", encoding="utf-8") as file:
            file.write("time_ms,velocity_counts_s\n")
            file.writelines(f"{ms},{1000 if ms == 12345 else 0}\n" for ms in range(20_000))
        run("compare", "a", "spike.csv", "--out", "spike.html")
        spikes(browser, place("spike.html"))
        check(not browser.errors, f"no page has an error: {browser.errors[:3]}")
        no_script(browser, place("a/report.html"))


if __name__ == "__main__":
    main(*sys.argv[1:])
