/** Requests of the tools and panels to the robot's server: JSON both ways. */

/**
 * An address on the server, with the token of the page's own address. The cookie has it, too, but
 * another server on this host may have replaced the cookie.
 */
export function serverAddress(path, query = {}) {
  const address = new URL(path, document.baseURI);
  const token = new URLSearchParams(location.search).get("token");
  for (const [name, value] of Object.entries(token ? { ...query, token } : query)) {
    address.searchParams.set(name, value);
  }
  return address;
}

export const toolAddress = (path, query) => serverAddress(`tools/${path}`, query);

/** @throws {Error} with the server's sentence, or a sentence that the server does not answer. */
async function ask(address, options) {
  const answer = await fetch(address, { cache: "no-store", ...options }).catch(() => null);
  const found = await answer?.json().catch(() => null);
  if (!answer?.ok) throw new Error(found?.error ?? "The robot's server does not answer.");
  return found;
}

export const get = (path, query) => ask(toolAddress(path, query));
export const post = (path, body) =>
  ask(toolAddress(path), { method: "POST", body: JSON.stringify(body) });
