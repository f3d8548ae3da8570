// The volumes of a server to choose from, each with the picture of its middle slice.
import { element } from './host';
import { request, statusOf, type VolumeEntry } from './protocol';

const kPause = 1000; // milliseconds, of a server that draws for others

async function pictureOf(id: number, token: string, tries = 5): Promise<string | undefined> {
  try {
    return URL.createObjectURL(await (await request(`volume/${id}/slice.png?size=320&build=0`, token)).blob());
  } catch (error) {
    if (statusOf(error) !== 503 || tries === 0) return undefined;
    await new Promise((done) => setTimeout(done, kPause));
    return pictureOf(id, token, tries - 1);
  }
}

// `choose` gets the id of the volume that the user opens.
export function showVolumes(volumes: readonly VolumeEntry[], token: string, choose: (id: string) => void): void {
  let turn = Promise.resolve(); // one picture after the other, of those that come into sight
  const sight = new IntersectionObserver((seen) => {
    for (const { target, isIntersecting } of seen) {
      if (!isIntersecting) continue;
      sight.unobserve(target);
      turn = turn.then(async () => {
        const picture = await pictureOf(Number((target as HTMLElement).dataset['id']), token);
        if (picture) target.querySelector('img')!.src = picture;
        target.classList.add(picture ? 'seen' : 'blind');
      });
    }
  });
  const filter = element<HTMLInputElement>('filter');
  const cards = volumes.map(({ id, name, error }) => {
    const template = element<HTMLTemplateElement>('list-card');
    const card = template.content.firstElementChild!.cloneNode(true) as HTMLElement;
    card.dataset['id'] = String(id);
    card.querySelector('span')!.textContent = card.title = name;
    card.querySelector('small')!.textContent = error ?? '';
    card.querySelector('button')!.addEventListener('click', () => choose(String(id)));
    sight.observe(card);
    return card;
  });
  filter.addEventListener('input', () => {
    const words = filter.value.toLowerCase();
    for (const card of cards) card.hidden = !card.title.toLowerCase().includes(words);
  });
  filter.hidden = volumes.length < 12;
  element('cards').replaceChildren(...cards);
  document.body.classList.add('choosing');
  document.title = `${volumes.length} volumes – isobrick`;
}
