// Opens the volume that the address names: the key of the server first, then its list.
import { element } from './host';
import { Page } from './page';
import { request, statusOf, type VolumeEntry } from './protocol';
import { showVolumes } from './volume_list';
import { fragmentOf, keepToken, keptToken, readFragment } from './view_link';

// The user's key: the address of the server, or the key in it.
function askToken(): Promise<string> {
  const dialog = element<HTMLDialogElement>('key');
  const text = element<HTMLInputElement>('key-text');
  dialog.showModal();
  return new Promise<Event>((resolve) => dialog.addEventListener('close', resolve, { once: true })).then(() => {
    const word = text.value.trim();
    return readFragment(word.slice(word.indexOf('#'))).token ?? word;
  });
}

async function start(): Promise<void> {
  const fragment = readFragment(location.hash);
  let token = fragment.token ?? keptToken() ?? (await askToken());
  let list: { volumes: VolumeEntry[]; steps: boolean } | undefined;
  while (list === undefined) {
    try {
      list = (await (await request('volumes', token)).json()) as NonNullable<typeof list>;
    } catch (error) {
      if (statusOf(error) !== 401) throw error;
      token = await askToken();
    }
  }
  const keeps = keepToken(token);
  const kept = keeps ? undefined : token;
  history.replaceState(null, '', fragmentOf({ ...fragment, token: kept }));
  addEventListener('hashchange', () => location.reload());
  const open = (volume: string | undefined): string =>
    (location.hash = fragmentOf({ token: kept, volume, view: undefined }));
  const { volumes, steps } = list;
  element('volumes').hidden = volumes.length < 2 || steps;
  element('volumes').addEventListener('click', () => open(undefined));
  const first = volumes.length === 1 || steps ? volumes[0] : undefined;
  const named = volumes.find(({ id }) => String(id) === fragment.volume) ?? first;
  if (named === undefined) return showVolumes(volumes, token, open);
  new Page(volumes, steps, named.id, token, keeps, fragment.view);
}

start().catch((error: unknown) => {
  element('status').textContent = '';
  element('trouble').textContent = error instanceof Error ? error.message : String(error);
});
