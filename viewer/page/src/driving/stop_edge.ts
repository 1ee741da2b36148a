/** The moment at which a machine reports that its emergency stop was pressed, by whomever. */

export class StopEdge {
  private stoppedMachine: string | null = null;

  /** Receive the shown machine and its stop; return whether that stop was pressed since the last call. */
  update(machine: string | null, isStopped: boolean): boolean {
    const stopped = isStopped ? machine : null;
    const isRising = stopped !== null && stopped !== this.stoppedMachine;
    this.stoppedMachine = stopped;
    return isRising;
  }
}
