// esbuild puts these files in as texts.
declare module '*.glsl' { const text: string; export default text; }
