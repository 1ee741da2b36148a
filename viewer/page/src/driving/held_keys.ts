/** Keys that are held. */
export class HeldKeys {
  private readonly names = new Set<string>();

  /** Names of the held keys, in the order in which they were pressed. */
  get list(): string[] {
    return [...this.names];
  }

  /**
   * Press a key. A repetition counts only if the key is held already: after `releaseAll` a finger that is still on the
   * key must be lifted before it deflects a lever again.
   *
   * @returns whether the set of keys changed.
   */
  press(name: string, isRepetition: boolean): boolean {
    if (isRepetition || this.names.has(name)) return false;
    this.names.add(name);
    return true;
  }

  /** Release a key; return whether it was held. */
  release(name: string): boolean {
    return this.names.delete(name);
  }

  /** Release all keys, as when the window loses the focus; return whether any was held. */
  releaseAll(): boolean {
    const any = this.names.size > 0;
    this.names.clear();
    return any;
  }
}
