/** Which of the machines is shown and driven. */

/**
 * Keeps the machine that the user sees over the moments in which it is unknown: a lost connection, a restarted node. While it
 * is unknown another one replaces it, which lever keys must not move: hands are still on them.
 */
export class MachineSelection {
  private wanted: string | null = null;

  /** Receive the choice of the user. */
  choose(machine: string): void {
    this.wanted = machine;
  }

  /** Forget the choice, as when another simulation is shown. */
  forget(): void {
    this.wanted = null;
  }

  /**
   * Return which machine is to be selected.
   *
   * @param machines those that there are.
   * @param selected the one that is selected now.
   * @param isKept whether that one must stay while it exists: it is driven.
   */
  pick(machines: Iterable<string>, selected: string | null, isKept: boolean): string | null {
    const known = new Set(machines);
    if (selected !== null && known.has(selected) && isKept) return selected;
    if (this.wanted !== null && known.has(this.wanted)) return this.wanted;
    if (selected !== null && known.has(selected)) return selected;
    const [first = null] = known;
    this.wanted ??= first;
    return first;
  }

  /** Return whether a machine replaces the one that the user saw. */
  isReplacement(machine: string | null): boolean {
    return machine !== null && this.wanted !== null && machine !== this.wanted;
  }
}
