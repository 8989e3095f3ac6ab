/* page.js - what is on the page is renewed as events come, without a word of its own: each part is
 * fetched from the server again, which has escaped it; a stream's picture grows by its events. */
'use strict';

const POINTS = 2000;                        // windows in a picture: more than a screen has pixels
const RENEW_MS = 1000, DRAW_MS = 250, RETRY_MS = 2000;
const body = document.body;

// -- the parts of the page ------------------------------------------------------------------------

function say(text, bad) {
  const live = document.getElementById('live');
  if (live.textContent !== text) live.textContent = text;
  live.className = bad ? 'bad' : '';
}

// What has the focus keeps it, though the element is another.
function replace(old, now) {
  const focus = document.activeElement;
  const inside = old.contains(focus);
  const key = e => e.id || e.getAttribute('href') || e.dataset.action || e.getAttribute('aria-label');
  const wanted = inside ? key(focus) : null;
  const scrolled = [...old.querySelectorAll('.wide')].map(e => e.scrollLeft);
  old.replaceWith(now);
  now.querySelectorAll('.wide').forEach((e, i) => { e.scrollLeft = scrolled[i] || 0; });
  if (inside)
    [...now.querySelectorAll('a, button, [tabindex]')].find(e => key(e) === wanted)?.focus();
}

let known = new Map([...document.querySelectorAll('[data-live]')].map(e => [e.id, e.outerHTML]));

async function renew() {
  let answer;
  try {
    answer = await fetch(location.href, {headers: {Accept: 'text/html'}});
  } catch {
    say('the page is away', true);
    return;
  }
  if (answer.status === 503) {
    say('the daemon is away', true);
    return;
  }
  const now = new DOMParser().parseFromString(await answer.text(), 'text/html');
  if (now.title !== document.title || (body.dataset.stream && !document.getElementById('damping'))) {
    if (answer.ok) location.reload();        // another page than this: the daemon is back
    return;
  }
  say('live');
  const parts = [...now.querySelectorAll('[data-live]')];
  for (const part of parts) {
    const old = document.getElementById(part.id), text = part.outerHTML;
    if (old && known.get(part.id) !== text) replace(old, document.adoptNode(part));
    else if (!old) document.getElementById('main').append(document.adoptNode(part));
    known.set(part.id, text);
  }
  body.dataset.poll = now.body.dataset.poll;
}

let due = null;
function renewSoon() {
  due ??= setTimeout(async () => { due = null; await renew(); }, RENEW_MS);
}

let polled = Date.now();
setInterval(() => {
  const every = Number(body.dataset.poll);
  if (every > 0 && !document.hidden && Date.now() - polled >= 1000 * every) {
    polled = Date.now();
    renew();
  }
}, 500);

// -- the picture of a stream ----------------------------------------------------------------------

const windows = [];                         // {x, epoch, modes: Map of track to its numbers}
let plots = [], drawn = '';

function colours() {
  const css = getComputedStyle(document.documentElement);
  return {ink: css.getPropertyValue('--ink').trim(), grid: css.getPropertyValue('--line').trim(),
          tracks: [...Array(8).keys()].map(i => css.getPropertyValue('--track' + i).trim())};
}

function tracksShown() {
  return [...new Set(windows.flatMap(w => [...w.modes.keys()]))].sort((a, b) => a - b).slice(-16);
}

function series(tracks, value, bar) {
  const data = [windows.map(w => w.x)];
  for (const track of tracks)
    for (const side of [0, 1, -1])
      data.push(windows.map(w => {
        const m = w.modes.get(track);
        if (!m || m[value] === null) return null;
        return side === 0 ? m[value] : m[bar] === null ? null : m[value] + side * m[bar];
      }));
  return data;
}

// A track is three series: its value, and the two ends of its standard error, with a band between;
// the picture is as high as the values are: one wild error must not make the others flat.
function makePlot(id, label, tracks, data) {
  const {ink, grid, tracks: palette} = colours(), box = document.getElementById(id);
  const axis = {stroke: ink, grid: {stroke: grid}, ticks: {stroke: grid}};
  const all = [{label: 'time, s'}], bands = [];
  tracks.forEach((track, i) => {
    const stroke = palette[track % palette.length], edge = {stroke, width: 0.5, auto: false, points: {show: false}};
    all.push({label: 'track ' + track, stroke, width: 2, points: {show: true, size: 5}},
             {label: '+ std', ...edge}, {label: '- std', ...edge});
    bands.push({series: [3 * i + 2, 3 * i + 3], fill: stroke + '40'});
  });
  box.replaceChildren();
  box.setAttribute('role', 'img');
  box.setAttribute('aria-label', label + ' of each track over time; the numbers stand below');
  return new uPlot({width: box.clientWidth || 600, height: 280, title: label, bands, series: all,
                    legend: {show: false}, cursor: {drag: {x: true, y: false}},
                    scales: {x: {time: false}}, axes: [{...axis, label: 'end of the window, s'}, {...axis, size: 70}]},
                   data, box);
}

const PICTURES = [['frequency', 'frequency, Hz', 'f', 'fs'], ['damping', 'damping ratio', 'z', 'zs']];

function draw() {
  if (!document.getElementById('damping') || windows.length === 0) return;
  const tracks = tracksShown(), shape = tracks.join();
  PICTURES.forEach(([id, label, value, bar], i) => {
    const data = series(tracks, value, bar);
    if (shape === drawn) plots[i].setData(data);
    else plots[i] = makePlot(id, label, tracks, data);
  });
  drawn = shape;
  document.getElementById('damping').dataset.windows = windows.length;
  document.getElementById('damping').dataset.last = windows.at(-1).x;
}

let drawing = null;
function drawSoon() {
  drawing ??= setTimeout(() => { drawing = null; draw(); }, DRAW_MS);
}

function addWindow(e) {
  const number = x => Number.isFinite(x) ? x : null;
  const x = Number.isFinite(e.dt) ? e.dt * e.to : e.to, last = windows.at(-1);
  if (!Array.isArray(e.modes) || !Number.isFinite(x)) return;
  if (last && (last.epoch !== e.epoch || x <= last.x)) windows.length = 0;
  const modes = new Map(e.modes.map(m => [m.track, {
    f: number(m.frequency_hz), fs: number(m.std?.frequency_hz),
    z: number(m.damping_ratio), zs: number(m.std?.damping_ratio)}]));
  windows.push({x, epoch: e.epoch, modes});
  if (windows.length > POINTS) windows.shift();
  drawSoon();
}

matchMedia('(prefers-color-scheme: dark)').addEventListener('change', () => { drawn = ''; draw(); });
addEventListener('resize', () => plots.forEach((p, i) => p.setSize(
  {width: document.getElementById(PICTURES[i][0]).clientWidth, height: 280})));

// -- events ---------------------------------------------------------------------------------------

function onEvent(e) {
  if (e.event === 'lost') location.reload();
  else if (body.dataset.stream && e.event === 'modes' && e.stream === body.dataset.stream) addWindow(e);
  renewSoon();
}

// A browser tries again by itself after a lost connection, but not after a 503.
function listen(last) {
  const source = new EventSource(last === null ? body.dataset.events : again(last));
  source.onopen = () => say('live');
  source.onmessage = m => {
    if (m.lastEventId !== '') last = Number(m.lastEventId);
    onEvent(JSON.parse(m.data));
  };
  source.addEventListener('daemon', m => {
    say(m.data === 'here' ? 'live' : 'the daemon is away', m.data !== 'here');
    if (m.data === 'here') renewSoon();
  });
  source.onerror = () => {
    say('reconnecting', true);
    if (source.readyState === EventSource.CLOSED) setTimeout(() => listen(last), RETRY_MS);
  };
}

function again(last) {
  const url = new URL(body.dataset.events, location.href);
  url.searchParams.set('from', last + 1);
  return url.href;
}

if (body.dataset.events) listen(null);

// -- actions --------------------------------------------------------------------------------------

document.addEventListener('click', async click => {
  const button = click.target.closest('[data-action]');
  if (!button) return;
  button.disabled = true;
  const answer = await fetch(location.pathname + '/' + button.dataset.action,
                             {method: 'POST', headers: {'X-Modald-Token': body.dataset.token}});
  if (!answer.ok)
    say(new DOMParser().parseFromString(await answer.text(), 'text/html')
          .querySelector('main p')?.textContent ?? 'refused', true);
  else if (button.dataset.action === 'delete') location.href = '/';
  else renewSoon();
});
