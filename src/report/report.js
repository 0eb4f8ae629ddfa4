'use strict';
(() => {
  const data = JSON.parse(document.getElementById('data').textContent);
  const { scene, figures } = data;
  const $ = (id) => document.getElementById(id);
  // Okabe and Ito's palette: distinguishable with any colour vision.
  const COLOURS = ['#0072B2', '#D55E00', '#009E73', '#CC79A7', '#E69F00', '#56B4E9', '#8C6D1F', '#7A5195'];
  const SYMBOLS = ['circle', 'diamond', 'square', 'x', 'cross', 'triangle-up', 'star', 'hexagon'];
  // In space only filled symbols are seen from afar.
  const SPACE_SYMBOLS = ['circle', 'diamond', 'square', 'circle', 'diamond', 'square', 'circle', 'diamond'];
  const AXES = [['x', '#D55E00'], ['y', '#009E73'], ['z', '#0072B2']];
  const colour = (i) => COLOURS[i % COLOURS.length];
  const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const narrow = () => window.innerWidth < 600;
  const config = { responsive: true, displaylogo: false, displayModeBar: narrow() ? false : 'hover', scrollZoom: false, modeBarButtonsToRemove: ['lasso2d', 'select2d', 'autoScale2d', 'hoverClosestCartesian', 'hoverCompareCartesian', 'toggleSpikelines'] };

  // Rotations and poses: [x, y, z, qx, qy, qz, qw].
  const turn = (q, v) => {
    const [x, y, z, w] = q;
    const t = [2 * (y * v[2] - z * v[1]), 2 * (z * v[0] - x * v[2]), 2 * (x * v[1] - y * v[0])];
    return [v[0] + w * t[0] + y * t[2] - z * t[1], v[1] + w * t[1] + z * t[0] - x * t[2], v[2] + w * t[2] + x * t[1] - y * t[0]];
  };
  const apply = (pose, v) => { const r = turn(pose.slice(3), v); return [r[0] + pose[0], r[1] + pose[1], r[2] + pose[2]]; };

  const axis = (title, more) => ({ title: { text: title, standoff: 8 }, gridcolor: css('--grid'), zerolinecolor: css('--line'), linecolor: css('--line'), automargin: true, ...more });
  const flat = (more) => ({ paper_bgcolor: 'rgba(0,0,0,0)', plot_bgcolor: 'rgba(0,0,0,0)', font: { color: css('--ink'), size: narrow() ? 11 : 13, family: 'system-ui, "DejaVu Sans", sans-serif' }, margin: { l: 56, r: 14, t: 14, b: 48 }, legend: { orientation: 'h', y: 1.02, yanchor: 'bottom', x: 0 }, hoverlabel: { bgcolor: css('--panel'), font: { color: css('--ink') } }, modebar: { bgcolor: 'rgba(0,0,0,0)', color: css('--soft'), activecolor: css('--accent') }, ...more });
  const far = narrow() ? 1.45 : 1;
  const EYES = { iso: { x: 1.35 * far, y: -1.35 * far, z: 0.85 * far }, top: { x: 0, y: -0.001, z: 2.1 * far }, front: { x: 0, y: -2.1 * far, z: 0.05 }, side: { x: 2.1 * far, y: 0, z: 0.05 } };
  // What is near is seen lower than what is far: looking a little below the middle fills the frame.
  const LOW = { x: 0, y: 0, z: narrow() ? -0.04 : -0.1 };
  // Least and greatest x, y and z of lists of them, a little wider, and nowhere without thickness.
  const span = (lists, margin = 0) => {
    const ranges = lists.map((list) => list.reduce(([a, b], v) => (v === null || v === undefined ? [a, b] : [Math.min(a, v), Math.max(b, v)]), [Infinity, -Infinity]));
    const most = Math.max(...ranges.map(([a, b]) => b - a)) || 1;
    return ranges.map(([a, b]) => { const more = Math.max(margin, 0.04 * (b - a), 0.02 * most); return [a - more, b + more]; });
  };
  // Whatever its shape, a box fills the figure: its diagonal is always the same, and it is never taller than the figure.
  const space = (units, ranges) => {
    const sides = ranges.map(([a, b]) => b - a), unit = Math.min(2.15 / Math.hypot(...sides), 1.12 / sides[2]);
    const one = (name, i) => ({ range: ranges[i], title: { text: `${name}, ${units}` }, gridcolor: css('--grid'), zerolinecolor: css('--line'), color: css('--ink'), backgroundcolor: 'rgba(0,0,0,0)', showspikes: false, ...(narrow() ? { nticks: 5, tickfont: { size: 9 } } : {}) });
    return flat({ margin: { l: 0, r: 0, t: 0, b: 0 }, legend: { orientation: 'h', y: 0.99, yanchor: 'top', x: 0.01, bgcolor: 'rgba(0,0,0,0)' }, uirevision: 'keep', scene: { xaxis: one('x', 0), yaxis: one('y', 1), zaxis: one('z', 2), aspectmode: 'manual', aspectratio: { x: unit * sides[0], y: unit * sides[1], z: unit * sides[2] }, uirevision: 'keep', camera: { eye: EYES.iso, center: LOW } } });
  };

  // --- the cell ---------------------------------------------------------------------------------
  const poseOf = (frame, stop) => { const f = scene.frames[frame]; return f.pose || (f.poses && f.poses[stop]) || null; };
  const size = (() => {
    let least = [Infinity, Infinity, Infinity], most = [-Infinity, -Infinity, -Infinity];
    scene.frames.forEach((f, i) => { const p = poseOf(i, 0); if (p) for (let k = 0; k < 3; k++) { least[k] = Math.min(least[k], p[k]); most[k] = Math.max(most[k], p[k]); } });
    const d = Math.hypot(...[0, 1, 2].map((k) => Math.max(0, most[k] - least[k])));
    return d > 0.05 ? d : 1;
  })();
  const lines = (segments) => {
    const out = { x: [], y: [], z: [] };
    for (const s of segments) { for (const p of s) { out.x.push(p[0]); out.y.push(p[1]); out.z.push(p[2]); } out.x.push(null); out.y.push(null); out.z.push(null); }
    return out;
  };
  // A tube with round ends between two points: a capsule.
  const capsule = (mesh, a, b, radius) => {
    const d = [b[0] - a[0], b[1] - a[1], b[2] - a[2]], n = Math.hypot(...d);
    const w = n > 1e-6 ? d.map((c) => c / n) : [0, 0, 1];
    const u0 = Math.abs(w[0]) < 0.9 ? [1, 0, 0] : [0, 1, 0];
    const cross = (p, q) => [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]];
    let u = cross(w, u0); const un = Math.hypot(...u); u = u.map((c) => c / un); const v = cross(w, u);
    const sides = 10, rings = [];
    for (const [end, lat] of [[a, -80], [a, -45], [a, 0], [b, 0], [b, 45], [b, 80]]) {
      const c = Math.cos(lat * Math.PI / 180) * radius, s = Math.sin(lat * Math.PI / 180) * radius, ring = [];
      for (let k = 0; k < sides; k++) {
        const t = 2 * Math.PI * k / sides, cu = c * Math.cos(t), cv = c * Math.sin(t);
        ring.push(mesh.x.length);
        mesh.x.push(end[0] + u[0] * cu + v[0] * cv + w[0] * s); mesh.y.push(end[1] + u[1] * cu + v[1] * cv + w[1] * s); mesh.z.push(end[2] + u[2] * cu + v[2] * cv + w[2] * s);
      }
      rings.push(ring);
    }
    for (let r = 0; r + 1 < rings.length; r++) for (let k = 0; k < sides; k++) {
      const [p, q, s, t] = [rings[r][k], rings[r][(k + 1) % sides], rings[r + 1][k], rings[r + 1][(k + 1) % sides]];
      mesh.i.push(p, q); mesh.j.push(q, t); mesh.k.push(s, s);
    }
  };
  const sphere = (() => { const out = []; for (let i = 0; i <= 8; i++) for (let k = 0; k < 14; k++) { const a = Math.PI * i / 8, b = 2 * Math.PI * k / 14; out.push([Math.sin(a) * Math.cos(b), Math.sin(a) * Math.sin(b), Math.cos(a)]); } return out; })();
  const swell = () => Math.pow(10, Number($('swell').value) / 10);
  const cellTraces = () => {
    const stop = $('stop') ? Number($('stop').value) : 0;
    const traces = [];
    const length = 0.045 * size;
    const shown = (f) => f.kind !== 'link' && f.kind !== 'part';
    AXES.forEach(([name, c], k) => {
      const segments = [];
      scene.frames.forEach((f, i) => { const p = poseOf(i, stop); if (!p || !shown(f)) return; const tip = [0, 0, 0]; tip[k] = length; segments.push([p.slice(0, 3), apply(p, tip)]); });
      traces.push({ type: 'scatter3d', mode: 'lines', name: `${name} axes`, ...lines(segments), line: { color: c, width: 4 }, hoverinfo: 'skip', legendgroup: 'axes', showlegend: !narrow() });
    });
    scene.robots.forEach((robot, r) => {
      const points = robot.frames.map((f) => poseOf(f, stop)).filter(Boolean).map((p) => p.slice(0, 3));
      if (points.length < 2) return;
      if (robot.links) {
        const mesh = { x: [], y: [], z: [], i: [], j: [], k: [] };
        for (let i = 0; i + 1 < points.length; i++) if (Math.hypot(...[0, 1, 2].map((c) => points[i + 1][c] - points[i][c])) > 0.01) capsule(mesh, points[i], points[i + 1], 0.05 * Math.max(0.6, 1 - 0.07 * i));
        traces.push({ type: 'mesh3d', name: robot.name, ...mesh, color: colour(r + 5), opacity: 0.45, flatshading: false, hoverinfo: 'name', showlegend: true, lighting: { ambient: 0.65, diffuse: 0.6 } });
      } else {
        traces.push({ type: 'scatter3d', mode: 'lines', name: `${robot.name} (base to flange)`, ...lines([points]), line: { color: colour(r + 5), width: 7, dash: 'dash' }, hoverinfo: 'name' });
      }
    });
    const frusta = [], depth = 0.11 * size;
    scene.cameras.forEach((camera) => {
      const p = poseOf(camera.frame, stop); if (!p) return;
      const corners = (camera.corners || [[-0.5, -0.4, 1], [0.5, -0.4, 1], [0.5, 0.4, 1], [-0.5, 0.4, 1]]).map((c) => apply(p, c.map((v) => v * depth)));
      const o = p.slice(0, 3);
      corners.forEach((c, i) => { frusta.push([o, c]); frusta.push([c, corners[(i + 1) % 4]]); });
    });
    if (frusta.length) traces.push({ type: 'scatter3d', mode: 'lines', name: 'cameras', ...lines(frusta), line: { color: colour(4), width: 3 }, hoverinfo: 'skip' });
    const squares = [];
    scene.targets.forEach((target) => { const p = poseOf(target.frame, stop); if (!p) return; target.outlines.forEach((o) => { const c = o.map((v) => apply(p, v)); squares.push([...c, c[0]]); }); });
    if (squares.length) traces.push({ type: 'scatter3d', mode: 'lines', name: 'targets', ...lines(squares), line: { color: css('--ink'), width: 2 }, hoverinfo: 'skip' });
    const grown = { x: [], y: [], z: [], i: [], j: [], k: [] };
    scene.ellipsoids.forEach((e) => {
      const p = poseOf(e.frame, stop), parent = poseOf(e.parent, stop); if (!p || !parent) return;
      const s = swell(), a = e.axes.map((c) => turn(parent.slice(3), c)), start = grown.x.length;
      sphere.forEach((v) => { for (const [k, key] of [[0, 'x'], [1, 'y'], [2, 'z']]) grown[key].push(p[k] + s * (a[0][k] * v[0] + a[1][k] * v[1] + a[2][k] * v[2])); });
      for (let i = 0; i < 8; i++) for (let k = 0; k < 14; k++) { const q = start + i * 14 + k, n = start + i * 14 + (k + 1) % 14; grown.i.push(q, n); grown.j.push(n, n + 14); grown.k.push(q + 14, q + 14); }
    });
    if (grown.x.length) traces.push({ type: 'mesh3d', name: 'uncertainty', ...grown, color: colour(3), opacity: 0.5, hoverinfo: 'skip', showlegend: true });
    const labels = { x: [], y: [], z: [], text: [] };
    scene.frames.forEach((f, i) => {
      const p = poseOf(i, stop); if (!p || !shown(f)) return;
      // Frames in one place share a label, so that their names do not cover each other.
      const same = labels.x.findIndex((x, k) => Math.hypot(x - p[0], labels.y[k] - p[1], labels.z[k] - p[2]) < 0.03 * size);
      if (same >= 0) { labels.text[same] += `, ${f.name}`; return; }
      labels.x.push(p[0]); labels.y.push(p[1]); labels.z.push(p[2]); labels.text.push(f.name);
    });
    traces.push({ type: 'scatter3d', mode: $('names').checked ? 'markers+text' : 'markers', name: 'frames', ...labels, customdata: labels.text, textposition: 'top center', textfont: { color: css('--ink'), size: narrow() ? 10 : 12 }, marker: { size: 3, color: css('--ink') }, hovertemplate: '%{customdata}<br>x %{x:.4f} m<br>y %{y:.4f} m<br>z %{z:.4f} m<extra></extra>' });
    return traces;
  };
  const say = () => {
    if ($('stop')) $('stop-value').textContent = scene.stops[Number($('stop').value)];
    const s = swell(); $('swell-value').textContent = `× ${s < 10 ? s.toFixed(1) : Math.round(s)}`;
  };
  // Names that would cover each other as the cell is seen now go below or beside their frame, or show only when it is pointed at.
  const PLACES = [['top center', -0.5, -1.4], ['bottom center', -0.5, 0.4], ['middle right', 0.08, -0.5], ['middle left', -1.08, -0.5]];
  const spreadNames = () => {
    const plot = $('cell'), names = plot.data.findIndex((trace) => trace.name === 'frames');
    const drawn = plot._fullLayout && plot._fullLayout.scene && plot._fullLayout.scene._scene;
    const eye = drawn && drawn.glplot && drawn.glplot.cameraParams;
    if (!eye || !eye.projection || !$('names').checked) return;
    const times = (m, v) => [0, 1, 2, 3].map((i) => m[i] * v[0] + m[4 + i] * v[1] + m[8 + i] * v[2] + m[12 + i] * v[3]);
    const { x, y, z, customdata, textfont } = plot.data[names], s = drawn.dataScale || [1, 1, 1];
    const taken = [], text = [], textposition = [];
    customdata.forEach((name, i) => {
      const p = times(eye.projection, times(eye.view, times(eye.model, [x[i] * s[0], y[i] * s[1], z[i] * s[2], 1])));
      const u = 0.5 * (1 + p[0] / p[3]) * plot.clientWidth, v = 0.5 * (1 - p[1] / p[3]) * plot.clientHeight;
      const w = 0.6 * textfont.size * name.length, h = 1.2 * textfont.size;
      const free = PLACES.find(([, a, b]) => {
        const box = [u + a * w, v + b * h, u + a * w + w, v + b * h + h];
        if (taken.some((t) => box[0] < t[2] && box[2] > t[0] && box[1] < t[3] && box[3] > t[1])) return false;
        taken.push(box);
        return true;
      });
      text.push(free ? name : '');
      textposition.push((free || PLACES[0])[0]);
    });
    return Plotly.restyle('cell', { text: [text], textposition: [textposition] }, [names]);
  };
  const cellRanges = (() => {
    const places = scene.frames.flatMap((f) => (f.pose ? [f.pose] : (f.poses || []).filter(Boolean)));
    return span([0, 1, 2].map((k) => places.map((p) => p[k])), 0.06 * size);
  })();
  let watched = false;
  const drawCell = async () => {
    say();
    await Plotly.react('cell', cellTraces(), space('m', cellRanges), config);
    if (!watched) { watched = true; $('cell').on('plotly_relayout', () => requestAnimationFrame(spreadNames)); }
    await new Promise(requestAnimationFrame);
    return spreadNames();
  };

  // --- paths ------------------------------------------------------------------------------------
  const drawPaths = () => {
    const path = figures.paths[Number($('path-target').value) || 0];
    const line = { color: css('--ink'), width: 2 };
    const hover = 'configuration %{text}<br>x %{x} mm<br>y %{y} mm<br>z %{z} mm';
    const traces = [{ type: 'scatter3d', mode: 'lines', name: 'computed', x: path.computed.x, y: path.computed.y, z: path.computed.z, text: path.computed.configuration, line: { ...line, width: 3 }, hovertemplate: hover }];
    path.measured.forEach((m, i) => traces.push({ type: 'scatter3d', mode: 'markers', name: m.by, x: m.x, y: m.y, z: m.z, text: m.configuration, marker: { size: 3, color: colour(i), symbol: SPACE_SYMBOLS[i % 8] }, hovertemplate: hover }));
    Plotly.react('path-space', traces, space('mm', span(['x', 'y', 'z'].map((k) => traces.flatMap((t) => t[k])))), config);
    for (const [id, a, b] of [['path-xy', 'x', 'y'], ['path-xz', 'x', 'z'], ['path-yz', 'y', 'z']]) {
      const plane = [];
      path.measured.forEach((m, i) => plane.push({ type: 'scatter', mode: 'markers', name: m.by, x: m[a], y: m[b], text: m.configuration, marker: { size: 4, color: colour(i), symbol: SYMBOLS[i % 8], opacity: 0.75 }, hovertemplate: `configuration %{text}<br>${a} %{x} mm<br>${b} %{y} mm` }));
      // On top, or the dots would hide it.
      plane.push({ type: 'scatter', mode: 'lines', name: 'computed', x: path.computed[a], y: path.computed[b], line: { ...line, width: 1 }, hoverinfo: 'skip' });
      Plotly.react(id, plane, flat({ xaxis: axis(`${a}, mm`), yaxis: axis(`${b}, mm`, { scaleanchor: 'x' }), showlegend: false }), config);
    }
  };

  // --- errors -----------------------------------------------------------------------------------
  const drawBoxes = () => {
    const traces = [];
    figures.errors.forEach((e, i) => {
      const box = (values, name, yaxis, xaxis, legend) => ({ type: 'box', name: e.by, legendgroup: e.by, showlegend: legend, y: values, x: values.map(() => name), yaxis, xaxis, marker: { color: colour(i), size: 3 }, line: { width: 1.5 }, boxpoints: values.length > 600 ? false : 'outliers', offsetgroup: String(i) });
      ['x', 'y', 'z'].forEach((n, k) => traces.push(box(e.shift[k], n, 'y', 'x', k === 0)));
      if (e.turn[0].length) ['rx', 'ry', 'rz'].forEach((n, k) => traces.push(box(e.turn[k], n, 'y2', 'x2', false)));
    });
    const turned = figures.errors.some((e) => e.turn[0].length);
    const tall = narrow() && turned;
    const layout = tall
      ? { xaxis: axis('', { domain: [0, 1], anchor: 'y' }), yaxis: axis('translation, mm', { domain: [0.57, 1] }), xaxis2: axis('', { domain: [0, 1], anchor: 'y2' }), yaxis2: axis('rotation, deg', { domain: [0, 0.43], anchor: 'x2' }) }
      : { xaxis: axis('', { domain: [0, turned ? 0.45 : 1] }), yaxis: axis('translation, mm'), xaxis2: axis('', { domain: [0.57, 1], anchor: 'y2' }), yaxis2: axis('rotation, deg', { anchor: 'x2' }) };
    if (!turned) { delete layout.xaxis2; delete layout.yaxis2; }
    Plotly.react('boxes', traces, flat({ boxmode: 'group', ...layout }), config);
  };
  const drawCloud = () => {
    const traces = [];
    figures.errors.forEach((e, i) => { if (e.world[0].length) traces.push({ type: 'scatter3d', mode: 'markers', name: e.by, x: e.world[0], y: e.world[1], z: e.world[2], text: e.target, marker: { size: 2.5, color: colour(i), symbol: SPACE_SYMBOLS[i % 8], opacity: 0.8 }, hovertemplate: '%{text}<br>x %{x} mm<br>y %{y} mm<br>z %{z} mm' }); });
    if (!traces.length) { $('cloud').closest('figure').hidden = true; return; }
    const reach = Math.max(...traces.flatMap((t) => [t.x, t.y, t.z].map((l) => l.reduce((m, v) => Math.max(m, Math.abs(v)), 0)))) * 0.25 || 1;
    traces.push({ type: 'scatter3d', mode: 'lines', name: 'the world', ...lines([[[0, 0, 0], [reach, 0, 0]], [[0, 0, 0], [0, reach, 0]], [[0, 0, 0], [0, 0, reach]]]), line: { color: css('--ink'), width: 5 }, hoverinfo: 'skip' });
    Plotly.react('cloud', traces, space('mm', span(['x', 'y', 'z'].map((k) => traces.flatMap((t) => t[k])))), config);
  };
  const drawStops = () => {
    const { px, mm } = figures.stops;
    const one = px.rms.length ? { of: px, unit: 'px' } : { of: mm, unit: 'mm' };
    Plotly.react('by-stop', [{ type: 'scatter', mode: 'markers', x: one.of.configuration, y: one.of.rms, marker: { size: 4, color: colour(0) }, hovertemplate: `configuration %{x}<br>%{y} ${one.unit}<extra></extra>` }], flat({ xaxis: axis('configuration'), yaxis: axis(`rms, ${one.unit}`, { rangemode: 'tozero' }), showlegend: false }), config);
  };

  // --- residuals --------------------------------------------------------------------------------
  const drawField = () => {
    const c = figures.residuals[Number($('camera').value) || 0];
    const rms = Math.sqrt(c.du.reduce((s, v, i) => s + v * v + c.dv[i] * c.dv[i], 0) / Math.max(1, c.du.length)) || 1;
    // In the middle of the slider the typical arrow is a fortieth of the picture.
    const unit = c.size[0] / 40 / rms, scale = unit * Math.pow(10, (Number($('stretch').value) - 20) / 20);
    $('stretch-value').textContent = `× ${scale < 10 ? scale.toFixed(1) : Math.round(scale)}`;
    const x = [], y = [];
    c.u.forEach((u, i) => { x.push(u, u + scale * c.du[i], null); y.push(c.v[i], c.v[i] + scale * c.dv[i], null); });
    const traces = [
      { type: 'scatter', mode: 'lines', x, y, line: { color: colour(1), width: 1 }, hoverinfo: 'skip', name: 'residual' },
      { type: 'scatter', mode: 'markers', x: c.u, y: c.v, customdata: c.du.map((d, i) => [d, c.dv[i]]), marker: { size: 3, color: colour(0) }, hovertemplate: 'u %{x} v %{y}<br>du %{customdata[0]} dv %{customdata[1]} px<extra></extra>', name: 'corner' },
    ];
    const box = { type: 'rect', x0: -0.5, y0: -0.5, x1: c.size[0] - 0.5, y1: c.size[1] - 0.5, line: { color: css('--soft'), width: 1 } };
    Plotly.react('field', traces, flat({ xaxis: axis('u, px', { range: [-10, c.size[0] + 10], constrain: 'domain' }), yaxis: axis('v, px', { range: [c.size[1] + 10, -10], scaleanchor: 'x', constrain: 'domain' }), shapes: [box] }), config);
    const middle = c.bins.u.map((_, i) => c.bins.from + (i + 0.5) * c.bins.width);
    const bars = ['u', 'v'].map((k, i) => ({ type: 'bar', name: k, x: middle, y: c.bins[k], width: c.bins.width, marker: { color: colour(i), pattern: { shape: i ? '/' : '', fgcolor: colour(i), fgopacity: 1 } }, opacity: 0.55, hovertemplate: '%{x:.3f} px: %{y}<extra></extra>' }));
    Plotly.react('histogram', bars, flat({ barmode: 'overlay', bargap: 0, xaxis: axis('residual, px'), yaxis: axis('corners') }), config);
  };
  const drawCorrelation = () => {
    const c = figures.correlation;
    // Where there is no room for every name, each block's stands at its middle.
    const few = c.labels.length <= (narrow() ? 16 : 48), blocks = [];
    c.labels.forEach((label, i) => {
      const name = few || !c.whole ? label : label.replace(/ [^ ]+$/, '');
      const last = blocks[blocks.length - 1];
      if (last && last.name === name) last.to = i; else blocks.push({ name, from: i, to: i });
    });
    const ticks = { tickmode: 'array', tickvals: blocks.map((b) => (b.from + b.to) / 2), ticktext: blocks.map((b) => b.name), showticklabels: !narrow() || few, tickfont: { size: few || blocks.length < 30 ? 10 : 8 } };
    Plotly.react('correlation', [{ type: 'heatmap', z: c.values, x: c.labels, y: c.labels, zmin: -1, zmax: 1, colorscale: [[0, '#0072B2'], [0.5, '#f7f7f7'], [1, '#D55E00']], colorbar: { title: { text: 'correlation' }, thickness: 12 }, hovertemplate: '%{y}<br>%{x}<br>%{z:.3f}<extra></extra>' }], flat({ xaxis: axis('', { ...ticks, tickangle: -60 }), yaxis: axis('', { ...ticks, autorange: 'reversed' }), margin: { l: 10, r: 10, t: 10, b: 10 } }), config);
  };

  // --- when and how -----------------------------------------------------------------------------
  const options = (id, names) => { names.forEach((name, i) => { const o = document.createElement('option'); o.value = i; o.textContent = name; $(id).append(o); }); $(id).closest('label').hidden = names.length < 2; };
  const jobs = [['cell', drawCell]];
  if (figures.paths.length) { options('path-target', figures.paths.map((p) => p.target)); jobs.push(['path-space', drawPaths]); $('path-target').addEventListener('change', drawPaths); }
  if (figures.errors.length) jobs.push(['boxes', drawBoxes], ['cloud', drawCloud], ['by-stop', drawStops]);
  if (figures.residuals.length) { options('camera', figures.residuals.map((c) => c.camera)); jobs.push(['field', drawField]); $('camera').addEventListener('change', drawField); $('stretch').addEventListener('input', drawField); }
  if (figures.correlation) jobs.push(['correlation', drawCorrelation]);
  const drawn = new Set();
  // The plotting library stands in the page as text, so that words and tables are on the screen before it is read.
  const load = () => {
    const text = $('library');
    if (!text) return;
    const script = document.createElement('script');
    script.textContent = text.textContent;
    text.remove();
    document.head.append(script);
  };
  const run = (id) => { load(); if (drawn.has(id)) return; drawn.add(id); jobs.find((j) => j[0] === id)[1](); };
  // A figure is drawn when it comes near the screen: a report of a large cell opens at once.
  const watcher = new IntersectionObserver((entries) => entries.forEach((e) => { if (e.isIntersecting) { run(e.target.id); watcher.unobserve(e.target); } }), { rootMargin: '300px' });
  const painted = (next) => requestAnimationFrame(() => requestAnimationFrame(() => setTimeout(next, 50)));
  painted(() => { load(); painted(() => jobs.forEach(([id]) => watcher.observe($(id)))); });
  const all = () => jobs.forEach(([id]) => run(id));
  window.cellmapDrawAll = all;
  let waiting = false;
  const soon = () => { if (waiting) return; waiting = true; requestAnimationFrame(() => { waiting = false; drawCell(); }); };
  ['stop', 'swell'].forEach((id) => $(id) && $(id).addEventListener('input', soon));
  $('names').addEventListener('change', soon);
  say();
  document.querySelectorAll('[data-view]').forEach((b) => b.addEventListener('click', () => Plotly.relayout('cell', { 'scene.camera': { eye: EYES[b.dataset.view], center: b.dataset.view === 'iso' ? LOW : { x: 0, y: 0, z: 0 }, up: { x: 0, y: 0, z: 1 } } })));
  const redraw = () => jobs.forEach(([id, draw]) => { if (drawn.has(id)) draw(); });
  $('theme').addEventListener('click', () => {
    const root = document.documentElement;
    const dark = root.dataset.theme ? root.dataset.theme === 'dark' : matchMedia('(prefers-color-scheme: dark)').matches;
    root.dataset.theme = dark ? 'light' : 'dark';
    $('theme').setAttribute('aria-pressed', String(!dark));
    redraw();
  });
  matchMedia('(prefers-color-scheme: dark)').addEventListener('change', redraw);
  // On paper everything is light, and as wide as the paper: figures are shrunk as they are, for a browser does not wait for new ones.
  const PAPER = 700;
  let before = null;
  window.addEventListener('beforeprint', () => {
    before = document.documentElement.dataset.theme || '';
    document.documentElement.dataset.theme = 'light';
    all();
    redraw();
    document.querySelectorAll('.plot').forEach((plot) => {
      const size = plot._fullLayout;
      if (!size) return;
      const shrink = (plot.closest('.row') ? 0.5 * PAPER - 10 : PAPER) / size.width;
      plot.style.setProperty('--shrink', shrink);
      plot.style.setProperty('--tall', `${Math.round(size.height * shrink)}px`);
      const drawn = size.scene && size.scene._scene;
      if (drawn && drawn.glplot && drawn.glplot.redraw) drawn.glplot.redraw();
    });
  });
  window.addEventListener('afterprint', () => {
    if (before) document.documentElement.dataset.theme = before; else delete document.documentElement.dataset.theme;
    redraw();
  });
})();
