/** The page of a report: script and style inside, so that one file says all, from a disk too. */
import { createHash } from "node:crypto";
import { readFileSync } from "node:fs";
import solid from "vite-plugin-solid";
import { type Plugin, defineConfig } from "vite";

/** What is inside, and must be named. */
const LICENCES = ["solid-js", "uplot"];

/** Puts the script and the style sheet into the document, with a content policy that allows these and nothing else. */
function inside(): Plugin {
  return {
    name: "rotortwin-report",
    enforce: "post",
    generateBundle(_, bundle) {
      const [page, ...pages] = Object.values(bundle).filter((one) => one.fileName.endsWith(".html"));
      const [script, ...scripts] = Object.values(bundle).filter((one) => one.type === "chunk");
      const styles = Object.values(bundle).filter((one) => one.fileName.endsWith(".css"));
      if (page?.type !== "asset" || script?.type !== "chunk" || pages.length + scripts.length > 0) {
        throw new Error("expected a document and a script of the report, one each");
      }
      // "</script" would end the element; in a text of a script it means the same with a backslash.
      const code = script.code.trim().replaceAll("</script", "<\\/script");
      const hash = createHash("sha256").update(code).digest("base64");
      const style = styles.map((one) => (one.type === "asset" ? String(one.source).trim() : "")).join("\n");
      const policy = `default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'sha256-${hash}'`;
      const licences = LICENCES.map((name) => `${name}: ${readFileSync(`node_modules/${name}/LICENSE`, "utf8").trim()}`).join("\n\n");
      const html = String(page.source)
        .replace(/\s*<script type="module"[^>]*src=[^>]*><\/script>/, "")
        .replace(/\s*<link rel="stylesheet"[^>]*>/g, "")
        .replace("<meta name=\"viewport\"", () => `<meta http-equiv="Content-Security-Policy" content="${policy}">\n    <meta name="viewport"`)
        .replace("</head>", () => `  <style>${style}</style>\n    <!--\n${licences}\n    -->\n  </head>`)
        .replace("</body>", () => `  <script type="module">${code}</script>\n  </body>`);
      for (const name of Object.keys(bundle)) delete bundle[name];
      this.emitFile({ type: "asset", fileName: "report.html", source: html });
    },
  };
}

export default defineConfig({
  plugins: [solid(), inside()],
  publicDir: false,
  build: {
    outDir: "dist-report",
    target: "es2022",
    modulePreload: false,
    cssCodeSplit: false,
    assetsInlineLimit: 0,
    rollupOptions: { input: "report.html", output: { codeSplitting: false } },
  },
});
