/** A report: the server's page for a result, in one file, with the result inside. Makes no requests. */
import { render } from "solid-js/web";
import { parseExact } from "../exact";
import { type Content, Report } from "./report";
import "../style.css";

const root = document.getElementById("root");
const inside = document.getElementById("report");
if (root && inside) {
  const content = parseExact(inside.textContent ?? "") as Content;
  root.textContent = "";
  render(() => <Report {...content} />, root);
}
