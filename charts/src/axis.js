'use strict';
// The rule of an axis, as in axis.rs, which has the reasons.
const axes = (() => {
  const LARGEST = 1e300, SMALLEST = 1e-300, FLAT = 1e-9;

  const has = (value, log) => value !== null && Math.abs(value) <= LARGEST && (!log || value >= SMALLEST);
  const isFlat = (span, size) => span <= Math.max(SMALLEST, FLAT * size);
  const exponent = value => +value.toExponential().split('e')[1];
  const decimal = (digits, power) => +`${digits}e${power}`;

  const range = (values, log, leastSpan, margin) => {
    let [min, max] = [Infinity, -Infinity];
    for (const value of values) if (has(value, log)) {
      if (value < min) min = value;
      if (value > max) max = value;
    }
    if (min > max) return log ? [1, 10] : [0, leastSpan || 1];
    if (log) {
      const factor = isFlat(max - min, max) ? 2 : margin > 0 ? 1.3 : 1;
      return [min / factor, max * factor];
    }
    const size = Math.max(Math.abs(min), Math.abs(max));
    const wanted = Math.max(leastSpan, max - min);
    const span = isFlat(wanted, size) ? size > SMALLEST ? size : 1 : wanted;
    const free = (span - (max - min)) / 2 + margin * span;
    return [min - free, max + free];
  };

  const label = (value, decade, size) => {
    if (size < 1e6 && decade > -6) return value.toFixed(Math.max(-decade, 0));
    if (value === 0) return '0';
    return value.toExponential(Math.max(exponent(Math.abs(value)) - decade, 0)).replace('e+', 'e');
  };
  const decades = (min, max, count) => {
    const [first, last, ratio] = [exponent(min), exponent(max), max / min];
    const steps = ratio > 1e6 ? [1] : ratio > 160 ? [1, 3] : [1, 2, 5];
    const every = steps.length > 1 ? 1 : Math.max(Math.floor((last - first) / count + 0.5), 1);
    const all = [];
    for (let decade = first; decade <= last; decade++) if (decade % every === 0)
      for (const value of steps.map(step => decimal(step, decade)))
        if (value >= min && value <= max) all.push([value, label(value, decade, value)]);
    return all;
  };
  const equidistant = (min, max, count) => {
    const size = Math.max(Math.abs(min), Math.abs(max));
    if (isFlat(max - min, size)) return [];
    const rough = (max - min) / count;
    const step = [1, 2, 5, 10].map(n => decimal(n, exponent(rough))).find(step => step >= rough * 0.999) || decimal(10, exponent(rough));
    const all = [];
    for (let n = Math.ceil(min / step); n <= Math.floor(max / step); n++) all.push([n * step, label(n * step, exponent(step), size)]);
    return all;
  };
  const ticks = ({ min, max, log }, count) => (log && max > 5 * min ? decades : equidistant)(min, max, Math.max(count, 1));

  // Maps values onto places; a logarithmic axis maps their logarithms.
  const axis = (min, max, from, to, log) => {
    const of = value => log ? Math.log10(value) : value;
    const [a, b] = [of(min), of(max)];
    return {
      min, max, from, to, log,
      has: value => has(value, log),
      at: value => from + (of(value) - a) / (b - a) * (to - from),
      value: place => {
        const value = a + (place - from) / (to - from) * (b - a);
        return log ? 10 ** value : value;
      },
    };
  };
  return { axis, has, isFlat, range, ticks };
})();
