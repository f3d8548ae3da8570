// The view in the address: '#view=' and the JSON of the state as base64url, so that it stays whole
// in mails and chats. The token of the server is never a part of it, unless the sender says so.
import type { ViewState } from './view_state';

// Fields as read, in the types and lengths of `known`; what is none of these keeps `known`'s value.
// A link is a stranger's: a wrong one changes nothing, and brings no error.
function merged(known: unknown, read: unknown, elements: Readonly<Record<string, unknown>>, name = ''): unknown {
  if (typeof known === 'number') return typeof read === 'number' && Math.abs(read) <= 1e30 ? read : known;
  if (typeof known === 'boolean') return typeof read === 'boolean' ? read : known;
  if (typeof known === 'string') return read === 'plain' || read === 'level' ? read : known;
  if (Array.isArray(known)) {
    if (!Array.isArray(read)) return known;
    const element = elements[name];
    if (element !== undefined) return read.slice(0, 64).map((value) => merged(element, value, elements));
    return known.map((value, i) => merged(value, read[i], elements));
  }
  const fields = (typeof read === 'object' && read !== null ? read : {}) as Record<string, unknown>;
  return Object.fromEntries(
    Object.entries(known as object).map(([key, value]) => [
      key,
      Object.hasOwn(fields, key) ? merged(value, fields[key], elements, key) : value,
    ]),
  );
}

const kElements = {
  surfaces: undefined as unknown,
  clip_planes: { normal: [1, 0, 0], offset: 0, enabled: true, cap: true },
  measurements: { points: [] },
  points: [0, 0, 0],
  beside: 0,
};

export function viewFromJson(text: string, first: ViewState): ViewState {
  try {
    const elements = { ...kElements, surfaces: first.surfaces[0] };
    const view = merged(first, JSON.parse(text), elements) as ViewState;
    return {
      ...view,
      surfaces: view.surfaces.length > 0 ? view.surfaces : first.surfaces,
      active_surface: Math.trunc(view.active_surface),
      measurements: view.measurements.filter(({ points }) => points.length === 2 || points.length === 3),
    };
  } catch {
    return first;
  }
}

// As a view file of the window and of `isobrick render --state`; `names`: of its volumes, in place of ids.
export function viewToJson(state: ViewState, names: { volume?: string; beside?: string[] } = {}): string {
  return JSON.stringify(
    { version: 1, ...state, ...names, focus: { ...state.focus, show_sphere: false }, show_box: false },
    (_, value: unknown) => (typeof value === 'number' ? Number(value.toPrecision(9)) : value),
  );
}

const toBase64Url = (text: string): string =>
  btoa(String.fromCharCode(...new TextEncoder().encode(text)))
    .replaceAll('+', '-')
    .replaceAll('/', '_')
    .replaceAll('=', '');

function fromBase64Url(text: string): string {
  try {
    const bytes = atob(text.replaceAll('-', '+').replaceAll('_', '/'));
    return new TextDecoder().decode(Uint8Array.from(bytes, (c) => c.charCodeAt(0)));
  } catch {
    return '';
  }
}

export interface Fragment {
  token: string | undefined;
  volume: string | undefined; // its id in /api/volumes
  view: string | undefined; // JSON
}

export function readFragment(hash: string): Fragment {
  const words = new URLSearchParams(hash.replace(/^#/, ''));
  const view = words.get('view');
  return {
    token: words.get('token') ?? undefined,
    volume: words.get('volume') ?? undefined,
    view: view === null ? undefined : fromBase64Url(view),
  };
}

export function fragmentOf({ token, volume, view }: Fragment): string {
  const words = Object.entries({ token, volume, view: view && toBase64Url(view) });
  return '#' + words.flatMap(([key, word]) => (word === undefined ? [] : `${key}=${encodeURIComponent(word)}`)).join('&');
}

// The token stays with the tab, so that a reload works and the address is free of it. Where a frame
// may keep nothing, it stays in the address. A proxy may have several servers, each at its path.
const kTokenKey = `isobrick-token ${new URL('.', document.baseURI).pathname}`;

function tabStorage(): Storage | undefined {
  try {
    return sessionStorage;
  } catch {
    return undefined;
  }
}

export const keptToken = (): string | undefined => tabStorage()?.getItem(kTokenKey) ?? undefined;

// Whether it could.
export function keepToken(token: string): boolean {
  tabStorage()?.setItem(kTokenKey, token);
  return tabStorage() !== undefined;
}
