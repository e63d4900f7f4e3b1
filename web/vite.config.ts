import solid from "vite-plugin-solid";
import { defineConfig } from "vitest/config";

// The server that `npm run dev` asks; another one by ROTORTWIN_SERVER.
const server = process.env["ROTORTWIN_SERVER"] ?? "http://127.0.0.1:8400";
const proxied = { target: server, changeOrigin: true, ws: true, headers: { origin: server } };

export default defineConfig({
  plugins: [solid()],
  base: "/",
  build: {
    target: "es2022",
    // Names by content: an old page never meets new parts, and equal sources give equal names.
    assetsDir: "assets",
    // The polyfill of module preloading would be an inline script, which the content policy refuses.
    modulePreload: { polyfill: false },
    assetsInlineLimit: 0,
    cssCodeSplit: false,
    reportCompressedSize: true,
    // three.js, which is loaded on demand.
    chunkSizeWarningLimit: 600,
  },
  server: {
    // Built-in mappings of logs are read from config/.
    fs: { allow: [".."] },
    proxy: { "/api": proxied, "/healthz": proxied, "/readyz": proxied, "/session": proxied },
  },
  test: { environment: "node", include: ["src/**/*.test.ts"] },
});
