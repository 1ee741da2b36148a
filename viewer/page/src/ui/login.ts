/** Form for the access token, and the reason if the server refuses the page. */

import { keepAccessToken } from "../access_token";
import type { UiContext } from "./context";
import { make, makeButton, setShown, setText } from "./dom";
import { sentence } from "./format";

/** Error codes that another token may solve. */
const TOKEN_CODES = new Set(["token_required", "wrong_token", "login_required"]);

export class Login {
  private readonly reason = make("p", { class: "login-reason", role: "alert", "data-testid": "login-reason" });
  private readonly input = make("input", {
    type: "password",
    id: "login-token",
    name: "token",
    autocomplete: "current-password",
    "data-testid": "login-token",
  });
  private readonly field = make("div", { class: "field" }, make("label", { for: "login-token" }, "Access token"), this.input);
  private readonly submit = make("button", { type: "submit", class: "button button-primary", "data-testid": "login-submit" });
  private readonly live: HTMLButtonElement;
  readonly element: HTMLElement;

  /** @param openLive shows the live simulation in place of a bag that cannot be opened. */
  constructor(
    private readonly context: UiContext,
    openLive: () => void,
  ) {
    this.live = makeButton(
      { testId: "login-live", label: "Show the live simulation", onClick: openLive },
      "Show the live simulation",
    );
    const hint = make("p", { class: "hint" }, "The server prints the token when it starts.");
    this.field.append(hint);
    const form = make(
      "form",
      { class: "panel login-form", "aria-label": "Log in" },
      make("h1", {}, "earthmoving_sim"),
      this.reason,
      // Browsers keep a password together with a name.
      make("input", { name: "username", autocomplete: "username", value: "viewer", hidden: true }),
      this.field,
      this.submit,
      this.live,
    );
    form.addEventListener("submit", (event) => {
      event.preventDefault();
      const { connection } = this.context.app;
      if (this.field.hidden) {
        connection.login({});
        return;
      }
      const token = this.input.value.trim();
      keepAccessToken(token);
      connection.login({ token });
    });
    this.element = make("div", { class: "login", "data-testid": "login", hidden: true }, form);
  }

  /** Whether the form is shown. */
  get isOpen(): boolean {
    return !this.element.hidden;
  }

  update(): void {
    const { connection } = this.context.app;
    const isRefused = connection.status === "refused";
    const wasShown = !this.element.hidden;
    setShown(this.element, isRefused);
    if (!isRefused) {
      if (wasShown && connection.status === "online") this.input.value = "";
      return;
    }
    const isToken = TOKEN_CODES.has(connection.refusalCode);
    if (isToken && !wasShown) keepAccessToken(""); // the one of this tab is wrong
    setShown(this.field, isToken);
    setShown(this.live, !isToken && connection.source !== "live");
    setText(this.reason, sentence(connection.refusal || "the server refused this page"));
    setText(this.submit, isToken ? "Log in" : "Try again");
    if (!wasShown) (isToken ? this.input : this.submit).focus();
  }
}
