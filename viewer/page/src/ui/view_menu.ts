/** Menu of what is drawn and how: colours of the terrain, effects, quality. */

import type { Part, UiContext } from "./context";
import { make, setText } from "./dom";
import { formatNumber } from "./format";
import type { EffectName, QualityName } from "./interfaces";
import { ChoiceList, Menu, Switch } from "./menu";

const QUALITIES = ["automatic", "low", "medium", "high"] as const;

const EFFECT_LABELS: Record<EffectName, string> = { smoke: "Exhaust smoke", dust: "Dust" };

/** The sound as a switch. */
export interface SoundSwitch {
  readonly isOn: boolean;
  setOn(on: boolean): void;
}

export class ViewMenu implements Part {
  private readonly menu: Menu;
  private readonly colorings: ChoiceList;
  private readonly quality: ChoiceList;
  private readonly qualityLevel = make("p", { class: "hint" });
  private readonly effects = new Map<EffectName, Switch>();
  private readonly soundSwitch: Switch;

  /** @param coloringChanged is called after the user has chosen another colouring. */
  constructor(
    private readonly context: UiContext,
    private readonly sound: SoundSwitch,
    coloringChanged: () => void,
  ) {
    const { view } = context.app;
    const colorings = view.colorings.map(({ id, label }) => ({ value: id, label }));
    this.colorings = new ChoiceList("Colours of the terrain", "coloring", colorings, (id) => {
      view.setColoring(id);
      coloringChanged();
    });
    const effects = make("fieldset", { class: "choices" }, make("legend", {}, "Effects"));
    for (const [name, label] of Object.entries(EFFECT_LABELS) as [EffectName, string][]) {
      const effect = new Switch(label, `effect-${name}`, (on) => view.setEffect(name, on));
      this.effects.set(name, effect);
      effects.append(effect.element);
    }
    this.soundSwitch = new Switch("Engine sound", "effect-sound", (on) => sound.setOn(on));
    effects.append(this.soundSwitch.element);
    const qualities = QUALITIES.map((value) => ({ value, label: value }));
    this.quality = new ChoiceList("Quality", "quality", qualities, (value) => {
      view.setQuality(value as QualityName | "automatic");
    });
    this.menu = new Menu(
      { testId: "view-menu", label: "View", icon: "view", onOpen: () => this.refresh() },
      this.colorings.element,
      effects,
      this.quality.element,
      this.qualityLevel,
    );
  }

  get element(): HTMLElement {
    return this.menu.element;
  }

  update(): void {
    if (!this.menu.panel.hidden) this.refresh();
  }

  private refresh(): void {
    const { view } = this.context.app;
    this.colorings.set(view.coloring());
    for (const [name, effect] of this.effects) effect.set(view.hasEffect(name));
    this.soundSwitch.set(this.sound.isOn);
    this.quality.set(view.selectedQuality());
    setText(this.qualityLevel, `In use: ${view.quality()}, ${formatNumber(view.framesPerSecond())} frames per second`);
  }
}
