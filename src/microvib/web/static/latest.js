// Questions that overtake each other: only the newest counts, whenever answers come.

/**
 * A place for answers. `ask(question, use)`: `question` gets a signal that ends it when a newer one is asked; `use` gets its
 * answer unless there is a newer one by then. Errors of overtaken questions are nothing. True where the answer was used.
 */
export function latest() {
  let newest = null;
  async function ask(question, use = () => {}) {
    newest?.abort();
    const mine = (newest = new AbortController());
    try {
      const answer = await question(mine.signal);
      if (mine !== newest) return false;
      await use(answer);
      return mine === newest;
    } catch (error) {
      if (mine !== newest) return false;
      throw error;
    }
  }
  /** What is under way counts no more. */
  ask.forget = () => {
    newest?.abort();
    newest = null;
  };
  return ask;
}
