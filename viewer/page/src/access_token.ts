/** Token of the address, which is kept for this tab. */

const STORAGE_KEY = "earthmoving.token";

/** Return the token of the address (`#token=...`) or of this tab; empty if there is none. It leaves the address bar. */
export function takeAccessToken(): string {
  const fragment = new URLSearchParams(location.hash.slice(1));
  const token = fragment.get("token");
  if (token === null) return sessionStorage.getItem(STORAGE_KEY) ?? "";
  fragment.delete("token");
  const rest = fragment.toString();
  history.replaceState(history.state, "", `${location.pathname}${location.search}${rest ? `#${rest}` : ""}`);
  keepAccessToken(token);
  return token;
}

/** Keep a token for reloads of this tab. */
export function keepAccessToken(token: string): void {
  sessionStorage.setItem(STORAGE_KEY, token);
}
