// Colours: of the vehicles, the same in scene, legend and plots, and of the two themes of the scene.
import { Color } from 'three';

// Okabe and Ito's colours, which all kinds of colour vision tell apart; for either background.
const FEW = {
  dark: ['#56B4E9', '#E69F00', '#2FC79A', '#E88BBE', '#F0E442', '#FF7A45', '#9DB7FF', '#C9D3DC'],
  light: ['#0072B2', '#D55E00', '#00805C', '#B8478F', '#8A7400', '#A13D00', '#3F51B5', '#37474F'],
};

export const THEMES = {
  dark: { ground: '#10171f', sky: '#0d1218', horizon: '#1d2a37', grid: '#3c5064', major: '#6d8aa6', east: '#e0665f', north: '#58c98e', frame: '#9fb0c0', blade: '#dfe8f0', label: '#eef4fa', halo: '#0b1016', link: '#58b8f0', pulse: '#ffffff', lost: '#ff3b30', desired: '#ffffff', shadow: 0.55, lights: [1.5, 2.4] },
  light: { ground: '#dfe7ee', sky: '#bcd3e6', horizon: '#eef3f7', grid: '#b3c2d0', major: '#7f93a6', east: '#b23a34', north: '#1c7c4c', frame: '#46535f', blade: '#26323c', label: '#121a22', halo: '#ffffff', link: '#3d94d6', pulse: '#00345c', lost: '#d6001c', desired: '#101820', shadow: 0.3, lights: [2.2, 2.0] },
};

/** The colour of vehicle i of n, as CSS has it. */
export function colourOf(i, n, theme) {
  if (n <= FEW[theme].length) return FEW[theme][i];
  const hue = n <= 24 ? i / n : (i * 0.618034) % 1;
  return `#${new Color().setHSL(hue, theme === 'dark' ? 0.72 : 0.7, theme === 'dark' ? 0.66 : 0.38).getHexString()}`;
}
