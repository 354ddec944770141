'use strict';
// Plays one recorded episode: a close-up of the road around the ego car, an overview above it, gauges and profile cursors.
// The data stand in the JSON element named "episode"; player.rs writes them.

(() => {
  const episode = JSON.parse(document.getElementById('episode').textContent);
  const root = document.getElementById('player');
  const frames = episode.frames;
  if (!frames.length) return;

  const part = (name) => root.querySelector(`[data-part="${name}"]`);
  const canvas = part('road');
  const ctx = canvas.getContext('2d');
  const scrubber = part('scrubber');
  const calm = matchMedia('(prefers-reduced-motion: reduce)');
  const dark = matchMedia('(prefers-color-scheme: dark)');

  const [tStart, tEnd] = [frames[0].t, frames[frames.length - 1].t];
  const clamp = (x, low, high) => Math.min(high, Math.max(low, x));
  const mix = (a, b, u) => a + (b - a) * u;
  const number = (x, digits) => x.toFixed(digits).replace('-', '\u2212').replace(/^\u2212(0\.?0*)$/, '$1');

  // Vehicles come as flat columns (id, ahead, d, speed); a map for each frame finds a vehicle in the next one.
  const sizes = new Map(episode.sizes.map(([id, length, width]) => [id, { length, width }]));
  for (const frame of frames) {
    frame.byId = new Map();
    for (let i = 0; i < frame.vehicles.length; i += 4) {
      const [id, ahead, d, v] = frame.vehicles.slice(i, i + 4);
      frame.byId.set(id, { ahead, d, v });
    }
  }

  // ---- The scene between two frames ----

  function frameBefore(t) {
    let [low, high] = [0, frames.length - 1];
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (frames[middle].t <= t) low = middle; else high = middle - 1;
    }
    return low;
  }

  function sceneAt(t) {
    const index = frameBefore(t);
    const [a, b] = [frames[index], frames[Math.min(index + 1, frames.length - 1)]];
    const dt = b.t - a.t;
    const u = dt > 0 ? clamp((t - a.t) / dt, 0, 1) : 0;
    const scene = { t, guard: a.guard, tick: episode.ticks[u > 0 ? b.tick : a.tick], index, vehicles: [] };
    for (const key of ['s', 'd', 'heading', 'v', 'accel', 'steer']) scene[key] = mix(a[key], b[key], u);
    for (const [id, from] of a.byId) {
      const to = b.byId.get(id);
      // A jump means that the vehicle went around the ring or left; it is then shown where it was.
      const moved = to && Math.abs(to.ahead - from.ahead) < 20 ? to : from;
      const run = b.s + moved.ahead - a.s - from.ahead;
      scene.vehicles.push({
        ...sizes.get(id),
        ahead: mix(from.ahead, moved.ahead, u), d: mix(from.d, moved.d, u), v: mix(from.v, moved.v, u),
        heading: run > 0.05 ? Math.atan2(moved.d - from.d, run) : 0,
        braking: dt > 0 && (moved.v - from.v) / dt < -1,
      });
    }
    return scene;
  }

  // ---- Drawing ----

  let colors = {};
  function readColors() {
    const style = getComputedStyle(root);
    for (const name of ['road', 'verge', 'mark', 'ink', 'muted', 'ego', 'path', 'outline', 'glass', 'surface']) {
      colors[name] = style.getPropertyValue(`--${name}`).trim();
    }
    colors.speed = [0, 1, 2, 3].map((i) => style.getPropertyValue(`--speed${i}`).trim().match(/\w\w/g).map((h) => parseInt(h, 16)));
  }

  function speedColor(v) {
    const [low, high] = episode.speedRange;
    const x = clamp((v - low) / Math.max(high - low, 0.1), 0, 1) * 3;
    const i = Math.min(Math.floor(x), 2);
    return `rgb(${colors.speed[i].map((c, k) => Math.round(mix(c, colors.speed[i + 1][k], x - i)))})`;
  }

  /** Where things are on the canvas: px per m along (`sx`) and across (`sy`), the ego's x, and y of d = 0. */
  function layout() {
    const width = canvas.clientWidth;
    const scale = clamp(width / 105, 6.5, 11);
    const lanes = episode.lanes;
    const mini = { sx: width / 240, sy: 10 / episode.laneWidth, x: width / 3, top: 4, bottom: 4 + 10 * lanes };
    mini.y = mini.bottom - 5;
    const top = mini.bottom + 26;
    const bottom = top + scale * episode.laneWidth * lanes;
    const main = { sx: scale, sy: scale, x: width * 0.36, top, bottom, y: bottom - scale * episode.laneWidth / 2 };
    return { width, height: bottom + 30, mini, main };
  }

  function roundRect(x, y, w, h, r) {
    ctx.beginPath();
    ctx.roundRect(x, y, w, h, r);
  }

  function drawRoad(view, width, scene) {
    const { lanes, laneWidth } = episode;
    ctx.fillStyle = colors.road;
    roundRect(0, view.top - 4, width, view.bottom - view.top + 8, 4);
    ctx.fill();
    ctx.strokeStyle = colors.mark;
    ctx.lineWidth = view.sx > 6 ? 2 : 1;
    const line = (y, dash) => {
      ctx.setLineDash(dash);
      ctx.lineDashOffset = (scene.s * view.sx - view.x) % (15 * view.sx);
      ctx.beginPath(); ctx.moveTo(0, y); ctx.lineTo(width, y); ctx.stroke();
    };
    for (let lane = 0; lane <= lanes; lane += 1) {
      const edge = lane === 0 || lane === lanes;
      line(view.bottom - lane * laneWidth * view.sy, edge ? [] : [6 * view.sx, 9 * view.sx]);
    }
    ctx.setLineDash([]);
  }

  function drawPosts(view, width, scene) {
    ctx.fillStyle = colors.muted;
    ctx.font = '11px system-ui, sans-serif';
    ctx.textAlign = 'center';
    for (let s = Math.ceil((scene.s - view.x / view.sx) / 20) * 20; ; s += 20) {
      const x = view.x + (s - scene.s) * view.sx;
      if (x > width) break;
      ctx.fillRect(x - 0.5, view.bottom + 8, 1, 5);
      if (x > 22 && x < width - 22) ctx.fillText(`${s} m`, x, view.bottom + 24);
    }
  }

  function drawBody(length, width, truck) {
    const r = Math.min(width * 0.28, 6);
    if (truck) {
      const cab = Math.min(length * 0.2, width * 1.1);
      roundRect(-length / 2, -width / 2, length - cab - width * 0.12, width, 2); ctx.fill(); ctx.stroke();
      roundRect(length / 2 - cab, -width * 0.46, cab, width * 0.92, r); ctx.fill(); ctx.stroke();
      ctx.fillStyle = colors.glass;
      roundRect(length / 2 - cab * 0.32, -width * 0.38, cab * 0.2, width * 0.76, 1); ctx.fill();
      return;
    }
    roundRect(-length / 2, -width / 2, length, width, r); ctx.fill(); ctx.stroke();
    ctx.fillStyle = colors.glass;
    roundRect(length * 0.1, -width * 0.38, length * 0.13, width * 0.76, r / 2); ctx.fill();
    roundRect(-length * 0.34, -width * 0.36, length * 0.09, width * 0.72, r / 2); ctx.fill();
  }

  function drawLights(length, width, braking, blinking) {
    const size = Math.max(2, width * 0.16);
    const lamp = (x, y, color) => { ctx.fillStyle = color; ctx.fillRect(x - size / 2, y - size / 2, size, size); };
    if (braking) for (const y of [-0.34, 0.34]) lamp(-length / 2 + 1, y * width, '#f03e3e');
    if (blinking) for (const x of [-0.46, 0.46]) lamp(x * length, -blinking * width * 0.42, '#ffb000');
  }

  function drawVehicle(view, vehicle, style) {
    const [length, width] = [vehicle.length * view.sx, vehicle.width * view.sy];
    ctx.save();
    ctx.translate(view.x + vehicle.ahead * view.sx, view.y - vehicle.d * view.sy);
    ctx.rotate(-Math.atan(Math.tan(vehicle.heading) * view.sy / view.sx));
    ctx.fillStyle = style.fill;
    ctx.strokeStyle = style.stroke;
    ctx.lineWidth = style.lineWidth;
    if (view.sx > 6) {
      drawBody(length, width, vehicle.length > 7);
      drawLights(length, width, vehicle.braking, style.blinking);
    } else {
      roundRect(-length / 2, -width / 2, length, width, 2); ctx.fill(); ctx.stroke();
    }
    ctx.restore();
  }

  function tracePath(view, scene, coefficients, from, to, now) {
    ctx.beginPath();
    for (let k = 0; k <= 40; k += 1) {
      const tau = mix(from, to, k / 40);
      const d = coefficients.reduceRight((sum, c) => sum * tau + c, 0);
      ctx.lineTo(view.x + scene.v * (tau - now) * view.sx, view.y - d * view.sy);
    }
    ctx.stroke();
  }

  /** The fan of candidates and the path being followed; times count from the start of the lane change. */
  function drawPaths(view, scene) {
    const { path, fan, start } = scene.tick;
    const now = scene.t - start;
    ctx.lineCap = 'round';
    ctx.strokeStyle = colors.path;
    for (const candidate of fan < 0 ? [] : episode.fans[fan]) {
      ctx.globalAlpha = 0.12 + 0.3 * candidate.rank;
      ctx.lineWidth = 1;
      tracePath(view, scene, candidate.coefficients, 0, candidate.duration, now);
    }
    if (path) {
      ctx.lineWidth = view.sx > 6 ? 3.5 : 2;
      ctx.globalAlpha = 0.45;
      tracePath(view, scene, path.coefficients, 0, clamp(now, 0, path.duration), now);
      ctx.globalAlpha = 1;
      tracePath(view, scene, path.coefficients, clamp(now, 0, path.duration), path.duration, now);
    }
    ctx.globalAlpha = 1;
    ctx.lineCap = 'butt';
  }

  function drawView(view, width, scene) {
    ctx.save();
    roundRect(0, view.top - 4, width, view.bottom - view.top + 8, 4);
    ctx.clip();
    drawRoad(view, width, scene);
    drawPaths(view, scene);
    for (const vehicle of scene.vehicles) {
      drawVehicle(view, vehicle, { fill: speedColor(vehicle.v), stroke: colors.outline, lineWidth: 1 });
    }
    const lit = calm.matches || Math.floor(scene.t * 3) % 2 === 0;
    const ego = { ahead: 0, d: scene.d, heading: scene.heading, length: episode.egoLength, width: episode.egoWidth, braking: scene.accel < -0.5 };
    drawVehicle(view, ego, { fill: colors.ego, stroke: colors.ink, lineWidth: 1.5, blinking: lit ? scene.tick.side : 0 });
    ctx.restore();
  }

  function drawWindow({ mini, main, width }) {
    const [x0, x1] = [-main.x, width - main.x].map((x) => mini.x + x / main.sx * mini.sx);
    ctx.strokeStyle = colors.muted;
    ctx.lineWidth = 1;
    ctx.globalAlpha = 0.8;
    roundRect(x0, mini.top - 3.5, x1 - x0, mini.bottom - mini.top + 7, 4); ctx.stroke();
    ctx.globalAlpha = 0.35;
    ctx.beginPath();
    ctx.moveTo(x0 + 2, mini.bottom + 4); ctx.lineTo(0, main.top - 4);
    ctx.moveTo(x1 - 2, mini.bottom + 4); ctx.lineTo(width, main.top - 4);
    ctx.stroke();
    ctx.globalAlpha = 1;
  }

  function draw(scene) {
    const place = layout();
    const ratio = window.devicePixelRatio || 1;
    canvas.style.height = `${place.height}px`;
    if (canvas.width !== Math.round(place.width * ratio) || canvas.height !== Math.round(place.height * ratio)) {
      canvas.width = Math.round(place.width * ratio);
      canvas.height = Math.round(place.height * ratio);
    }
    ctx.setTransform(ratio, 0, 0, ratio, 0, 0);
    ctx.clearRect(0, 0, place.width, place.height);
    drawView(place.mini, place.width, scene);
    drawView(place.main, place.width, scene);
    drawWindow(place);
    drawPosts(place.main, place.width, scene);
  }

  // ---- Gauges, profile cursors, clock ----

  const gauges = Object.fromEntries(['speed', 'accel', 'steer', 'decision', 'weights', 'guard', 'clock'].map((n) => [n, part(n)]));
  const cursors = [...document.querySelectorAll('svg[data-time-low]')].map((svg) => {
    const [low, high, left, right] = ['timeLow', 'timeHigh', 'left', 'right'].map((key) => Number(svg.dataset[key]));
    return { svg, low, high, left, right, line: svg.querySelector('.cursor') };
  });
  const setBar = (name, share) => part(`${name}-bar`).style.setProperty('--share', clamp(share, -1, 1));
  const setText = (node, text) => { if (node.textContent !== text) node.textContent = text; };

  function progress({ t, tick: { path, side, start, weights } }) {
    if (!path) return weights;
    const change = `to the ${side > 0 ? 'left' : 'right'}, ${number(clamp(t - start, 0, path.duration), 1)} of ${number(path.duration, 1)} s`;
    return weights ? `${weights}, ${change}` : change;
  }

  function showGauges(scene) {
    const degrees = scene.steer * 180 / Math.PI;
    setText(gauges.speed, number(scene.v * 3.6, 1));
    setText(gauges.accel, number(scene.accel, 2));
    setText(gauges.steer, number(degrees, 2));
    setBar('speed', scene.v / Math.max(episode.speedRange[1], 1));
    setBar('accel', scene.accel / episode.accelSpan);
    setBar('steer', -scene.steer / episode.steerSpan);
    setText(gauges.decision, scene.tick.words);
    setText(gauges.weights, progress(scene));
    setText(gauges.guard, scene.guard || 'idle');
    gauges.guard.classList.toggle('on', scene.guard !== '');
    setText(gauges.clock, `${number(scene.t, 1)} / ${number(tEnd, 1)} s`);
    for (const { line, low, high, left, right } of cursors) {
      const x = mix(left, right, (scene.t - low) / (high - low));
      line.setAttribute('transform', `translate(${x.toFixed(1)} 0)`);
    }
  }

  // ---- Playing ----

  let time = clamp(episode.poster, tStart, tEnd);
  let playing = false;
  let untouched = true;
  let last = 0;
  const rate = part('rate');
  const play = part('play');

  function show() {
    // With reduced motion, the picture changes once a decision instead of scrolling.
    const shown = calm.matches && playing ? tStart + Math.floor((time - tStart) / episode.decisionPeriod) * episode.decisionPeriod : time;
    const scene = sceneAt(shown);
    draw(scene);
    showGauges(scene);
    scrubber.value = shown;
    scrubber.setAttribute('aria-valuetext', `${number(shown, 1)} seconds, ${scene.tick.words}, ${number(scene.v * 3.6, 0)} kilometers per hour`);
  }

  function step(now) {
    if (!playing) return;
    time = Math.min(time + (now - last) / 1000 * Number(rate.value), tEnd);
    last = now;
    if (time >= tEnd) setPlaying(false); else requestAnimationFrame(step);
    show();
  }

  function setPlaying(on) {
    if (on && time >= tEnd) time = tStart;
    // The still shown first is in the middle of a lane change; playing starts with the approach.
    if (on && untouched) time = Math.max(tStart, time - 5);
    untouched = false;
    playing = on;
    play.setAttribute('aria-label', on ? 'Pause' : 'Play');
    play.dataset.playing = on;
    last = performance.now();
    if (on) requestAnimationFrame(step);
  }

  function seek(t) {
    untouched = false;
    time = clamp(t, tStart, tEnd);
    show();
  }

  play.addEventListener('click', () => setPlaying(!playing));
  canvas.addEventListener('click', () => { root.focus({ preventScroll: true }); setPlaying(!playing); });
  scrubber.addEventListener('input', () => seek(Number(scrubber.value)));
  root.addEventListener('keydown', (event) => {
    if (event.target === rate) return;
    const jump = { ArrowLeft: -1, ArrowRight: 1, ArrowDown: -5, ArrowUp: 5 }[event.key];
    if (event.key === ' ') setPlaying(!playing);
    else if (jump) seek(time + jump * (event.shiftKey ? episode.controlPeriod : 1));
    else if (event.key === 'Home' || event.key === 'End') seek(event.key === 'Home' ? tStart : tEnd);
    else return;
    event.preventDefault();
  });
  // A button would also act on the release of the space bar.
  play.addEventListener('keyup', (event) => { if (event.key === ' ') event.preventDefault(); });
  for (const { svg, low, high, left, right } of cursors) {
    const seekTo = (event) => {
      const box = svg.getBoundingClientRect();
      const x = (event.clientX - box.left) / box.width * svg.viewBox.baseVal.width;
      seek(mix(low, high, (x - left) / (right - left)));
    };
    svg.addEventListener('pointerdown', seekTo);
    svg.addEventListener('pointermove', (event) => { if (event.buttons) seekTo(event); });
  }
  const refresh = () => { readColors(); show(); };
  dark.addEventListener('change', refresh);
  calm.addEventListener('change', show);
  addEventListener('beforeprint', refresh);
  new ResizeObserver(show).observe(canvas.parentElement);
  root.classList.add('ready');
  refresh();
})();
