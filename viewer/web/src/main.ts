// Opens the volume that the address names: the key of the server first, then its list.
import { element } from './host';
import { Page } from './page';
import { request, RequestError, type VolumeEntry } from './protocol';
import { fragmentOf, keepToken, keptToken, readFragment } from './view_link';

// The user's key: the address of the server, or the key in it.
function askToken(): Promise<string> {
  const dialog = element<HTMLDialogElement>('key');
  const text = element<HTMLInputElement>('key-text');
  dialog.showModal();
  return new Promise((resolve) => {
    const close = (): void => {
      const word = text.value.trim();
      resolve(readFragment(word.slice(word.indexOf('#'))).token ?? word);
    };
    dialog.addEventListener('close', close, { once: true });
  });
}

async function volumesOf(token: string): Promise<VolumeEntry[]> {
  return ((await (await request('volumes', token)).json()) as { volumes: VolumeEntry[] }).volumes;
}

async function start(): Promise<void> {
  const fragment = readFragment(location.hash);
  let token = fragment.token ?? keptToken() ?? (await askToken());
  let volumes: VolumeEntry[] | undefined;
  while (volumes === undefined) {
    try {
      volumes = await volumesOf(token);
    } catch (error) {
      if (!(error instanceof RequestError) || error.status !== 401) throw error;
      token = await askToken();
    }
  }
  const keeps = keepToken(token);
  const kept = keeps ? undefined : token;
  const id = Number(fragment.volume ?? volumes[0]?.id ?? 0);
  history.replaceState(null, '', fragmentOf({ ...fragment, token: kept, volume: String(id) }));
  const list = element<HTMLSelectElement>('volumes');
  list.hidden = volumes.length < 2;
  element('name').hidden = !list.hidden;
  list.replaceChildren(...volumes.map((entry) => new Option(entry.name, String(entry.id), false, entry.id === id)));
  list.addEventListener('change', () => {
    history.replaceState(null, '', fragmentOf({ token: kept, volume: list.value, view: undefined }));
    location.reload();
  });
  new Page(id, token, keeps, fragment.view);
}

start().catch((error: unknown) => {
  element('status').textContent = '';
  element('trouble').textContent = error instanceof Error ? error.message : String(error);
});
