// Files that the browser saves.

export function save(blob: Blob, name: string): void {
  const link = document.createElement('a');
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 60_000);
}

// What the canvases show, one over the other. The first has to be drawn in the same task.
export function savePicture(layers: readonly HTMLCanvasElement[], name: string): void {
  const picture = document.createElement('canvas');
  picture.width = layers[0]!.width;
  picture.height = layers[0]!.height;
  const context = picture.getContext('2d')!;
  for (const layer of layers) context.drawImage(layer, 0, 0);
  picture.toBlob((blob) => blob && save(blob, name), 'image/png');
}
